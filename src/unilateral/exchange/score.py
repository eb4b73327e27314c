"""The errors of other solvers' solutions beside this project's own, rates, the worst places, a verdict."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, discretise, solve_condensed_problem
from unilateral.exchange.boundary_function import BoundaryFunction, piecewise_constant, piecewise_linear
from unilateral.exchange.diagnosis import Diagnosis, diagnose_solution
from unilateral.exchange.discrete_conditions import list_conditions
from unilateral.exchange.exported_folder import SAME_PLACE_RATIO, ExportedLevel, ForeignSolution
from unilateral.formulas.decimals import format_down, format_up
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.norms.dual import DualNorm, Errors, build_dual_norm
from unilateral.norms.ritz import h1_distance
from unilateral.problems.case_certificate import PROVED_RATES
from unilateral.problems.problem import Problem

MAX_RATE_SHORTFALL = 0.1
"""A rate between finite levels may stay below the proved one by this: set, not derived.

For comparison: a factor ln(1/H) in the square of an error takes 1/(2 ln(1/H)) of the rate, 0.1 at H = 1/128.
"""
MIN_RATED_ERROR = 1e-12
"""Errors up to this count as 0 up to rounding, and have no rate."""
UNCHECKED_CONDITIONS = "without a multiplier the conditions were not looked at"


@dataclass(frozen=True, eq=False)
class ScoredSolution:
    """The errors of one solution, this project's own on the same level, and what is wrong."""

    solution: ForeignSolution
    errors: Errors
    reference_errors: Errors
    diagnosis: Diagnosis
    extremes: Extremes | None

    @property
    def faults(self) -> list[str]:
        """Sentences on what is wrong."""
        return [str(fault) for fault in self.diagnosis.faults]


class Rate(NamedTuple):
    """`observed` is the least rate over so many `pairs` of levels, and `own` that of this project.

    `proved` is NaN where no rate is proved.
    """

    observed: float
    pairs: int
    own: float
    proved: float

    @property
    def has_proved_rate(self) -> bool | None:
        """Whether it is the proved rate, less MAX_RATE_SHORTFALL; None if not judged, or none is proved."""
        is_judged = self.pairs > 0 and not math.isnan(self.proved)
        return self.observed >= self.proved - MAX_RATE_SHORTFALL if is_judged else None

    @property
    def verdict(self) -> str:
        """The verdict on the rate in a few words."""
        if self.pairs == 0:
            return "not judged"
        if self.has_proved_rate is None:
            return "no rate is proved"
        return "reaches the proved rate" if self.has_proved_rate else "falls short"


@dataclass(frozen=True, eq=False)
class ReferenceSolution:
    """A solution of a case on a level by this project, and its errors, beside which others are scored."""

    discrete: CondensedProblem
    norm: DualNorm
    u_h: Array
    errors: Errors


def solve_reference(case: Problem, level: ExportedLevel) -> ReferenceSolution:
    """The solution of a case on an exported level by this project, and its errors."""
    discrete = discretise(case, level.mesh, level.partition)
    norm = build_dual_norm(level.partition, [case.known_solution()])
    solved = solve_condensed_problem(discrete)
    lambda_H = piecewise_constant(level.partition, solved.lambda_H) if discrete.unique else None
    errors = _compute_solution_errors(norm, case, level.mesh, solved.u_h, lambda_H)
    return ReferenceSolution(discrete, norm, solved.u_h, errors)


def score_solution(case: Problem, solution: ForeignSolution) -> ScoredSolution:
    """The errors of one solution; those of lambda are NaN without a multiplier."""
    reference = solve_reference(case, solution.level)
    errors = _compute_solution_errors(
        reference.norm, case, solution.level.mesh, solution.u, solution.multiplier
    )
    diagnosis = diagnose_solution(case, solution, reference.discrete, reference.errors, reference.u_h)
    return ScoredSolution(
        solution, errors, reference.errors, diagnosis, find_extremes(case, solution, reference.discrete)
    )


def _compute_solution_errors(
    norm: DualNorm, case: Problem, mesh: Mesh, u: Array, mu: BoundaryFunction | None
) -> Errors:
    """Errors of u in H1 and of mu in H^{-1/2}, between bounds (Proposition 6), and in L2; NaN without mu."""
    exact = case.known_solution()
    h1 = h1_distance(exact, mesh, u)
    if mu is None:
        return Errors(h1, math.nan, math.nan, math.nan)
    # on clamped sides there is no lambda
    contact_multiplier = mu.zero_on_sides(case.clamped_sides)
    lower, upper = norm.bound_error(exact, contact_multiplier.values[None], contact_multiplier.partition)
    return Errors(h1, float(lower[0]), float(upper[0]), contact_multiplier.distance(exact))


def compute_rates(case: Problem, scored_solutions: Sequence[ScoredSolution]) -> dict[str, Rate]:
    """The rates over all levels, by norm; in H^{-1/2} the error is the root mean square of its bounds.

    Pairs are compared from where the case says that it is asymptotic, and by the factor that it names.
    """
    holds = all(case.known_solution().declaration["hypotheses"].values())
    by_norm = {}
    for norm, proved in PROVED_RATES.items():
        begin, factor = _read_asymptotic_range(case, norm)
        pairs = list(_pair_levels(scored_solutions, begin, factor))
        judged_rates = _compute_pair_rates([(a.errors, b.errors) for a, b in pairs], norm, factor)
        reference_rates = _compute_pair_rates(
            [(a.reference_errors, b.reference_errors) for a, b in pairs], norm, factor
        )
        # a rate is reached if it is on every pair
        observed = min(judged_rates, default=math.nan)
        reference = min(reference_rates, default=math.nan)
        by_norm[norm] = Rate(observed, len(judged_rates), reference, proved if holds else math.nan)
    return by_norm


def _compute_pair_rates(pairs: Sequence[tuple[Errors, Errors]], norm: str, factor: float) -> list[float]:
    """The rates between errors that are neither NaN nor 0 up to rounding, which has no rate."""
    errors = [(select_error(coarse, norm), select_error(fine, norm)) for coarse, fine in pairs]
    rated = [(coarse, fine) for coarse, fine in errors if coarse > MIN_RATED_ERROR and fine > MIN_RATED_ERROR]
    # error = C h^rate on both levels
    return [math.log(coarse / fine) / math.log(factor) for coarse, fine in rated]


def _read_asymptotic_range(case: Problem, norm: str) -> tuple[float, float]:
    """The h from which on a case says that rates in a norm count, and the factor between two such h."""
    declared = case.known_solution().declaration["asymptotic"][norm]
    return parse_real(declared["from"], norm), float(declared.get("factor", 2))


def explain_missing_rate(case: Problem, scored_solutions: Sequence[ScoredSolution], norm: str) -> str:
    """Why there is no rate in a norm: no two levels that count, or errors that are 0 or not known."""
    begin, factor = _read_asymptotic_range(case, norm)
    if any(_pair_levels(scored_solutions, begin, factor)):
        return "the errors are 0 or not known"
    h = Fraction(begin).limit_denominator(10**6)
    H = Fraction(2 * begin).limit_denominator(10**6)
    return f"needs two levels with h <= {h} and H <= {H}, whose h differ by a factor of {factor:g}"


def _pair_levels(
    scored_solutions: Sequence[ScoredSolution], max_h: float, factor: float
) -> Iterator[tuple[ScoredSolution, ScoredSolution]]:
    """Pairs of a coarser and a finer level by that factor apart, from h = `max_h` and H = 2 `max_h` on."""
    ladder = sorted(scored_solutions, key=lambda scored: -scored.solution.level.mesh.h)
    for coarse in ladder:
        level = coarse.solution.level
        if max(level.mesh.h, level.partition.H / 2) > max_h * (1 + SAME_PLACE_RATIO):
            continue
        for fine in ladder:
            if abs(level.mesh.h / fine.solution.level.mesh.h - factor) < SAME_PLACE_RATIO:
                yield coarse, fine


def select_error(errors: Errors, norm: str) -> float:
    """The error in a norm; of two bounds the root mean square."""
    if norm == "hm12":
        return math.sqrt(0.5 * (errors.hm12_lower**2 + errors.hm12_upper**2))
    return errors.h1 if norm == "h1" else errors.l2


def format_errors(errors: Errors) -> tuple[str, str, str]:
    """The three errors as text, the second with its bounds; "-" where one is not known."""
    dual = [] if math.isnan(errors.hm12_lower) else [format_down(errors.hm12_lower, ".4g")]
    dual += [] if math.isnan(errors.hm12_upper) else [format_up(errors.hm12_upper, ".4g")]
    h1 = "-" if math.isnan(errors.h1) else f"{errors.h1:.4g}"
    l2 = "-" if math.isnan(errors.l2) else f"{errors.l2:.4g}"
    return h1, " to ".join(dual) or "-", l2


def list_fault_sentences(scored_solutions: Sequence[ScoredSolution]) -> Iterator[str]:
    """Each fault and each remark once: the files that have it, and what the finest of these shows."""
    occurrences: dict[str, list[tuple[str, str]]] = {}
    for scored in sorted(scored_solutions, key=lambda solution: solution.solution.level.mesh.h):
        for fault in scored.diagnosis.faults:
            measured = f": {fault.detail} ({scored.solution.level.name})"
            occurrences.setdefault(fault.description, []).append((scored.solution.file, measured))
        for remark in scored.diagnosis.remarks:
            occurrences.setdefault(remark, []).append((scored.solution.file, ""))
    for sentence, where in occurrences.items():
        every = len(where) == len(scored_solutions) > 1
        files = f"all {len(where)} solutions" if every else ", ".join(file for file, _ in where)
        yield f"{files}: {sentence}{where[0][1]}"


def describe_finest_extremes(scored_solutions: Sequence[ScoredSolution]) -> str:
    """Where the finest solution violates the conditions most; empty where all sides are free or clamped."""
    finest = min(scored_solutions, key=lambda scored: scored.solution.level.mesh.h)
    return f"{finest.solution.level.name}, {finest.extremes}" if finest.extremes else ""


def passes_judgement(scored_solutions: Sequence[ScoredSolution], rates: dict[str, Rate]) -> bool:
    """Whether nothing is wrong, and no rate falls short of a proved one."""
    has_faults = any(scored.faults for scored in scored_solutions)
    falls_short = any(rate.has_proved_rate is False for rate in rates.values())
    return not (has_faults or falls_short)


def state_verdict(scored_solutions: Sequence[ScoredSolution], rates: dict[str, Rate]) -> str:
    """The verdict in a few words: faults come before rates, and what was not looked at comes last."""
    if any(scored.faults for scored in scored_solutions):
        return "faults were found"
    if any(rate.has_proved_rate is False for rate in rates.values()):
        return "falls short of a proved rate"
    judged = any(rate.has_proved_rate for rate in rates.values())
    if any(scored.solution.multiplier is None for scored in scored_solutions):
        return (
            f"{'reaches the proved rates' if judged else 'no fault was found inside'}; {UNCHECKED_CONDITIONS}"
        )
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

    is_nodal: bool
    gap: Extreme
    multiplier: Extreme | None
    product: Extreme | None

    def as_numbers(self) -> dict[str, Any]:
        """The extremes for programs; null where there is no multiplier."""
        values = {"gap_least": self.gap, "lambda_least": self.multiplier, "product_largest": self.product}
        where = "values at the nodes" if self.is_nodal else "means over the cells"
        return {"of": where} | {name: extreme and extreme._asdict() for name, extreme in values.items()}

    def __str__(self) -> str:
        """The extremes in a line. A lambda that is constant on the cells is its own mean."""
        where, gap = ("at the nodes", "(u - g)") if self.is_nodal else ("over the cells", "mean(u - g)")
        names = (f"min {gap}", "min lambda", f"max |lambda {gap}|")
        texts = [
            f"{name} = {extreme}"
            for name, extreme in zip(names, self[1:], strict=True)
            if extreme is not None
        ]
        return f"{where}: {', '.join(texts)}"


def find_extremes(case: Problem, solution: ForeignSolution, discrete: CondensedProblem) -> Extremes | None:
    """Extremes for the first conditions that the multiplier may belong to, at the nodes without one.

    None if all sides are free or clamped.
    """
    mesh = discrete.mesh
    mu = solution.multiplier
    conditions = next(
        list_conditions(case, discrete, mu or piecewise_linear(mesh, np.zeros(len(mesh.boundary))))
    )
    if not len(conditions.s):
        return None
    gap = conditions.gaps(solution.u[mesh.boundary])
    side = mesh.polygon.sides_of(conditions.s)
    place = mesh.polygon.at(side, conditions.s - mesh.polygon.starts[side])

    def extreme_at(values: Array, k: int) -> Extreme:
        """The k-th value with its place."""
        x, y = place[k].tolist()
        return Extreme(float(values[k]), (x, y), int(side[k]))

    least_gap = extreme_at(gap, int(gap.argmin()))
    if mu is None:
        return Extremes(True, least_gap, None, None)
    product = np.abs(conditions.mu * gap)
    return Extremes(
        is_nodal=mu.nodal_values is not None,
        gap=least_gap,
        multiplier=extreme_at(conditions.mu, int(conditions.mu.argmin())),
        product=extreme_at(product, int(product.argmax())),
    )
