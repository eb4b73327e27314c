"""The errors of other solvers' solutions beside this project's own, rates, the worst places, a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, discretise, solve
from unilateral.exchange.boundary_function import Trace, constant, continuous
from unilateral.exchange.diagnosis import Judged, judged
from unilateral.exchange.discrete_conditions import conditions
from unilateral.exchange.exported_folder import SAME, ExportedLevel, Foreign
from unilateral.formulas.decimals import down, up
from unilateral.formulas.formula import real
from unilateral.geometry.mesh import Mesh
from unilateral.norms.dual import DualNorm, Errors, dual_norm
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case_certificate import PROVED
from unilateral.problems.problem import Problem

ROOM = 0.1
"""A rate between finite levels may stay below the proved one by this: set, not derived.

For comparison: a factor ln(1/H) in the square of an error takes 1/(2 ln(1/H)) of the rate, 0.1 at H = 1/128.
"""

ROUNDING = 1e-12
UNSEEN = "without a multiplier the conditions were not looked at"


@dataclass(frozen=True, eq=False)
class Scored:
    """The errors of one solution, this project's own on the same level, and what is wrong."""

    given: Foreign
    errors: Errors
    own: Errors
    told: Judged
    extremes: Extremes | None

    @property
    def faults(self) -> list[str]:
        """What is wrong, in sentences."""
        return [str(fault) for fault in self.told.faults]


class Rate(NamedTuple):
    """`observed` is the least rate over so many `pairs` of levels, and `own` that of this project.

    `proved` is NaN where no rate is proved.
    """

    observed: float
    pairs: int
    own: float
    proved: float

    @property
    def reaches(self) -> bool | None:
        """Whether it is the proved rate, less ROOM; None where it is not judged, and where none is proved."""
        is_judged = self.pairs > 0 and not math.isnan(self.proved)
        return self.observed >= self.proved - ROOM if is_judged else None

    @property
    def verdict(self) -> str:
        """The verdict in a few words."""
        if self.pairs == 0:
            return "not judged"
        if self.reaches is None:
            return "no rate is proved"
        return "reaches the proved rate" if self.reaches else "falls short"


@dataclass(frozen=True, eq=False)
class OwnSolution:
    """This project's solution of a case on a level, and its errors, beside which others are scored."""

    discrete: CondensedProblem
    norm: DualNorm
    u_h: Array
    errors: Errors


def solve_level(case: Problem, level: ExportedLevel) -> OwnSolution:
    """This project's solution of a case on an exported level."""
    discrete = discretise(case, level.mesh, level.cells)
    norm = dual_norm(level.cells, [case.known_solution()])
    solved = solve(discrete)
    lambda_H = constant(level.cells, solved.lambda_H) if discrete.unique else None
    errors = _errors(norm, case, level.mesh, solved.u_h, lambda_H)
    return OwnSolution(discrete, norm, solved.u_h, errors)


def score(case: Problem, given: Foreign) -> Scored:
    """The errors of one solution; those of lambda are NaN without a multiplier."""
    own = solve_level(case, given.level)
    errors = _errors(own.norm, case, given.level.mesh, given.u, given.multiplier)
    told = judged(case, given, own.discrete, own.errors, own.u_h)
    return Scored(given, errors, own.errors, told, extremes(case, given, own.discrete))


def _errors(norm: DualNorm, case: Problem, mesh: Mesh, u: Array, mu: Trace | None) -> Errors:
    exact = case.known_solution()
    h1 = h1_distance(exact, mesh, u)
    if mu is None:
        return Errors(h1, math.nan, math.nan, math.nan)
    on = mu.without(case.clamped_sides)
    lower, upper = norm.of_error(exact, on.values[None], on.cells)
    return Errors(h1, float(lower[0]), float(upper[0]), on.distance(exact))


def rates(case: Problem, scored: Sequence[Scored]) -> dict[str, Rate]:
    """The rates over all levels, by norm; in H^{-1/2} the error is the root mean square of its bounds.

    Pairs are compared from where the case says that it is asymptotic, and by the factor that it names.
    """
    holds = all(case.known_solution().declaration["hypotheses"].values())
    by_norm = {}
    for norm, proved in PROVED.items():
        begin, factor = _asymptotic(case, norm)
        pairs = list(_pairs(scored, begin, factor))
        theirs = _observed([(a.errors, b.errors) for a, b in pairs], norm, factor)
        own = _observed([(a.own, b.own) for a, b in pairs], norm, factor)
        least = min(theirs, default=math.nan)
        own_least = min(own, default=math.nan)
        by_norm[norm] = Rate(least, len(theirs), own_least, proved if holds else math.nan)
    return by_norm


def _observed(pairs: Sequence[tuple[Errors, Errors]], norm: str, factor: float) -> list[float]:
    """The rates between errors that are neither NaN nor 0 up to rounding, which has no rate."""
    errors = [(error_in(coarse, norm), error_in(fine, norm)) for coarse, fine in pairs]
    known = [(coarse, fine) for coarse, fine in errors if coarse > ROUNDING and fine > ROUNDING]
    return [math.log(coarse / fine) / math.log(factor) for coarse, fine in known]


def _asymptotic(case: Problem, norm: str) -> tuple[float, float]:
    """The h from which on a case says that rates in a norm count, and the factor between two such h."""
    declared = case.known_solution().declaration["asymptotic"][norm]
    return real(declared["from"], norm), float(declared.get("factor", 2))


def why_not_judged(case: Problem, scored: Sequence[Scored], norm: str) -> str:
    """Why there is no rate in a norm: no two levels that count, or errors that are 0 or not known."""
    begin, factor = _asymptotic(case, norm)
    if any(_pairs(scored, begin, factor)):
        return "the errors are 0 or not known"
    h = Fraction(begin).limit_denominator(10**6)
    H = Fraction(2 * begin).limit_denominator(10**6)
    return f"needs two levels with h <= {h} and H <= {H}, whose h differ by a factor of {factor:g}"


def _pairs(scored: Sequence[Scored], begin: float, factor: float) -> Iterator[tuple[Scored, Scored]]:
    """Pairs of a coarser and a finer level by that factor apart, from h = begin and H = 2 begin on."""
    ladder = sorted(scored, key=lambda each: -each.given.level.mesh.h)
    for coarse in ladder:
        level = coarse.given.level
        if max(level.mesh.h, level.cells.H / 2) > begin * (1 + SAME):
            continue
        for fine in ladder:
            if abs(level.mesh.h / fine.given.level.mesh.h - factor) < SAME:
                yield coarse, fine


def error_in(errors: Errors, norm: str) -> float:
    """The error in a norm; of two bounds the root mean square."""
    if norm == "hm12":
        return math.sqrt(0.5 * (errors.hm12_lower**2 + errors.hm12_upper**2))
    return errors.h1 if norm == "h1" else errors.l2


def texts(errors: Errors) -> tuple[str, str, str]:
    """The three errors as text, the second with its bounds; "-" where one is not known."""
    dual = [] if math.isnan(errors.hm12_lower) else [down(errors.hm12_lower, ".4g")]
    dual += [] if math.isnan(errors.hm12_upper) else [up(errors.hm12_upper, ".4g")]
    h1 = "-" if math.isnan(errors.h1) else f"{errors.h1:.4g}"
    l2 = "-" if math.isnan(errors.l2) else f"{errors.l2:.4g}"
    return h1, " to ".join(dual) or "-", l2


def sentences(scored: Sequence[Scored]) -> Iterator[str]:
    """Each fault and each remark once: the files that have it, and what the finest of these shows."""
    found: dict[str, list[tuple[str, str]]] = {}
    for one in sorted(scored, key=lambda each: each.given.level.mesh.h):
        for fault in one.told.faults:
            measured = f": {fault.measured} ({one.given.level.name})"
            found.setdefault(fault.what, []).append((one.given.file, measured))
        for remark in one.told.remarks:
            found.setdefault(remark, []).append((one.given.file, ""))
    for what, where in found.items():
        every = len(where) == len(scored) > 1
        files = f"all {len(where)} solutions" if every else ", ".join(file for file, _ in where)
        yield f"{files}: {what}{where[0][1]}"


def at_boundary(scored: Sequence[Scored]) -> str:
    """Where the finest solution violates the conditions most; empty where all sides are free or clamped."""
    finest = min(scored, key=lambda each: each.given.level.mesh.h)
    return f"{finest.given.level.name}, {finest.extremes}" if finest.extremes else ""


def holds(scored: Sequence[Scored], found: dict[str, Rate]) -> bool:
    """Whether nothing is wrong, and no rate falls short of a proved one."""
    has_faults = any(each.faults for each in scored)
    falls_short = any(rate.reaches is False for rate in found.values())
    return not (has_faults or falls_short)


def verdict(scored: Sequence[Scored], found: dict[str, Rate]) -> str:
    """The verdict in a few words: faults come before rates, and what was not looked at comes last."""
    if any(each.faults for each in scored):
        return "faults were found"
    if any(rate.reaches is False for rate in found.values()):
        return "falls short of a proved rate"
    judged = any(rate.reaches for rate in found.values())
    if any(each.given.multiplier is None for each in scored):
        return f"{'reaches the proved rates' if judged else 'no fault was found inside'}; {UNSEEN}"
    return "reaches the proved rates" if judged else "no fault was found; rates are not judged"


class Extreme(NamedTuple):
    """A value, and its place on a side."""

    value: float
    place: tuple[float, float]
    side: int

    def __str__(self) -> str:
        return f"{self.value:.3g} at ({self.place[0]:g}, {self.place[1]:g}) on side {self.side}"


class Extremes(NamedTuple):
    """Extremes of values at the nodes, or of the means over the cells; without a multiplier `gap` alone."""

    at_nodes: bool
    gap: Extreme
    multiplier: Extreme | None
    product: Extreme | None

    def as_numbers(self) -> dict[str, Any]:
        """The extremes for programs; null where there is no multiplier."""
        values = {"gap_least": self.gap, "lambda_least": self.multiplier, "product_largest": self.product}
        where = "values at the nodes" if self.at_nodes else "means over the cells"
        return {"of": where} | {name: each and each._asdict() for name, each in values.items()}

    def __str__(self) -> str:
        """The extremes in a line. A lambda that is constant on the cells is its own mean."""
        where, gap = ("at the nodes", "(u - g)") if self.at_nodes else ("over the cells", "mean(u - g)")
        names = (f"min {gap}", "min lambda", f"max |lambda {gap}|")
        known = [f"{name} = {of}" for name, of in zip(names, self[1:], strict=True) if of is not None]
        return f"{where}: {', '.join(known)}"


def extremes(case: Problem, given: Foreign, discrete: CondensedProblem) -> Extremes | None:
    """The extremes for the first conditions that the multiplier may belong to, else at the nodes.

    None if all sides are free or clamped. At a node lambda is its integral with the hat over that of the hat.
    """
    mesh = discrete.mesh
    mu = given.multiplier
    each = next(conditions(case, discrete, mu or continuous(mesh, np.zeros(len(mesh.boundary)))))
    if not len(each.s):
        return None
    gap = each.means(given.u[mesh.boundary])
    side = mesh.polygon.sides_of(each.s)
    place = mesh.polygon.at(side, each.s - mesh.polygon.starts[side])

    def at(values: Array, k: int) -> Extreme:
        x, y = place[k].tolist()
        return Extreme(float(values[k]), (x, y), int(side[k]))

    least = at(gap, int(gap.argmin()))
    if mu is None:
        return Extremes(True, least, None, None)
    product = np.abs(each.mu * gap)
    at_nodes = mu.nodal is not None
    return Extremes(at_nodes, least, at(each.mu, int(each.mu.argmin())), at(product, int(product.argmax())))
