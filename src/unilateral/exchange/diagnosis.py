"""Why a solution is wrong, told from what it leaves of the equations that it claims to solve.

All is measured in the dual norm of V_h, where it is an error of u in H1. What is left counts if it is more
than an algebraic error may be: the same share of the discretisation error for others as for this project.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem
from unilateral.exchange.boundary_function import Trace, constant, of_reactions
from unilateral.exchange.discrete_conditions import ROUNDING, conditions, mistaken, moves
from unilateral.exchange.equation_bugs import EXPLAINS, explanations, not_given, renumbered, with_load
from unilateral.exchange.equation_residual import Fit, Residual, flux_load
from unilateral.exchange.exported_folder import Foreign
from unilateral.exchange.fault import Fault, either, unexplained, wrong
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.formulas.decimals import down, up
from unilateral.geometry.mesh import Mesh
from unilateral.norms.dual import Errors
from unilateral.problems.problem import Problem
from unilateral.solvers.stop import Stop

COUNTS = Stop.fraction
"""What is left counts if it exceeds this fraction of this project's error on the same level.

Up to there a rate over a factor of 2 changes by 0.03 at most.
"""
NO_ERROR = 1e-10
"""An error of lambda below this fraction of the error of u counts as 0."""
REMARK = "the load is that of f {}; its error adds to yours, and is no fault"


class Judged(NamedTuple):
    """What is wrong with a solution, and what is not, but worth knowing."""

    faults: list[Fault]
    remarks: list[str]


def judged(case: Problem, given: Foreign, discrete: CondensedProblem, own: Errors, u_h: Array) -> Judged:
    """What is wrong with a solution, by this project's `own` errors on the level, and its u_h (n,).

    A bug inside is told only if without it, and without further known bugs of the multiplier or the
    conditions, a right solution is left. Of several such bugs those are told that need the fewest further
    ones.
    """
    allowed = COUNTS * own.h1
    mu = given.multiplier
    exported = Residual(discrete, given.u, discrete.load)
    of, how = with_load(case, exported, mu.load(discrete.mesh) if mu else None, allowed)
    holds = of.inside <= allowed
    remarks = [REMARK.format(how)] if how else []
    found = list(_at_boundary(case, mu, of, own)) if holds else []
    if holds and all(each.explained for each in found):
        return Judged(found, remarks)
    told = [
        [each.bug, *_at_boundary(case, mu and each.multiplier(mu), each.residual, own)]
        for each in explanations(case, of, allowed)
        if mu is not None or not each.both
    ]
    told = [each for each in told if all(fault.explained for fault in each)]
    if told:
        fewest = min(map(len, told))
        best = [each for each in told if len(each) == fewest]
        return Judged([either([each[0] for each in best]), *best[0][1:]], [])
    if holds:
        return Judged(found, remarks)
    other = renumbered(case, of, u_h)
    faults = [other] if other else [_inside(of), *not_given(of, allowed)]
    return Judged([*faults, *_against_exact(mu, of, own)], [])


def _inside(of: Residual) -> Fault:
    x, y = of.worst()
    return unexplained(
        "the equation does not hold inside the domain",
        "the linear solve stopped too early, the load is another one, or u is not meant as P1",
        f"the residual is {of.inside:.2g} in {of.names[1]}, and largest at ({x:g}, {y:g})",
    )


def _at_boundary(case: Problem, mu: Trace | None, of: Residual, own: Errors) -> Iterator[Fault]:
    """What is wrong on clamped sides, with the multiplier, by u's equation, and with its conditions."""
    yield from not_given(of, COUNTS * own.h1)
    if mu is None:
        return
    allowed = _allowed(of, own)
    first = MeantMultiplier("", mu.load(of.discrete.mesh), mu)
    right = of.nearer_to(first.load)
    misfit = of.norm(first.load - right)
    if misfit <= allowed:
        yield from _of_conditions(case, mu, of, allowed)
        return
    most = min(allowed, EXPLAINS * misfit)
    others = list(readings(mu, of.discrete.mesh, right))
    meant = [each for each in others if of.norm(each.load - right) <= most] or [
        each for each in ahead(case, mu, of, right) if of.norm(each.load - right) <= most
    ][:1]
    if meant:
        yield either([Fault(each.fault, "read in this way it fits u's equation") for each in meant])
        reading = meant[0]
    else:
        fits = ((each, of.fitted(each.load, right)) for each in (first, *others))
        reading = next((each for each, fit in fits if fit.left < abs(fit.factor) * allowed), first)
        yield from _scaled(reading.fault, of.fitted(reading.load, right), allowed, *of.names)
    if reading.mu is not None:
        yield from _of_conditions(case, reading.mu, of, allowed)


def _allowed(of: Residual, own: Errors) -> float:
    """How much may be left at the boundary."""
    return COUNTS * (own.hm12_lower if own.hm12_lower > NO_ERROR * own.h1 else own.h1) + of.inside


def _scaled(fault: str, fit: Fit, allowed: float, form: str, norm: str) -> Iterator[Fault]:
    """The faults of a multiplier that has not the right scale, if it was meant as in a reading."""
    if fault:
        yield Fault(fault, "read in this way it fits u's equation up to a factor")
    if fit.factor == fit.left == 0:
        yield Fault(
            "the multiplier is 0 everywhere, but that of u's equation is not", f"its norm is {fit.size:.2g}"
        )
    elif _is_scaled(fit, allowed):
        right = f"what u's equation has, to {up(fit.left / fit.size, '.1g')}"
        yield wrong("the multiplier", fit.factor, right)
    elif not fault:
        measured = f"{form} - <lambda, v> - (f, v) is {fit.misfit:.2g} in {norm}"
        yield unexplained("u and the multiplier do not fit", "", measured)


def _is_scaled(fit: Fit, allowed: float) -> bool:
    """Whether the multiplier surely has the wrong sign, or nothing but a factor is wrong with it."""
    of_factor = abs(fit.factor - 1) * fit.size
    only = fit.left < of_factor and fit.left <= max(abs(fit.factor) * allowed, COUNTS * fit.misfit)
    return only or fit.factor * fit.size < -fit.left


def _against_exact(mu: Trace | None, of: Residual, own: Errors) -> Iterator[Fault]:
    """A wrong sign by the exact multiplier, if it is surer than what is left and this project's error."""
    if mu is None:
        return
    fit = of.fitted(mu.load(of.discrete.mesh), flux_load(of.discrete))
    uncertain = fit.left + own.hm12_upper
    if fit.factor * fit.size < -uncertain:
        yield wrong("the multiplier", fit.factor, f"the exact one, to {up(uncertain / fit.size, '.1g')}")


def _of_conditions(case: Problem, mu: Trace, of: Residual, allowed: float) -> Iterator[Fault]:
    """The other conditions that u has, if it has none of those that belong to mu."""
    right = []
    missed = {}
    for each in conditions(case, of.discrete, mu):
        right.append(each)
        load, bound = each.multiplier_load(of.discrete.spaces.condensed, of.trace, allowed)
        missed[each.what] = of.norm(of.boundary - load) - bound
        if missed[each.what] <= allowed:
            return
    nearest = min(missed, key=lambda what: missed[what])
    most = min(allowed, EXPLAINS * missed[nearest])
    distance = f"at least {down(missed[nearest], '.2g')} in {of.names[1]}"
    measured = f"u is {distance} away from the solution with u >= g {nearest}"
    found = set()
    for what, each in mistaken(case, of.discrete, mu, right, of.u[of.discrete.mesh.boundary]):
        load, bound = each.multiplier_load(of.discrete.spaces.condensed, of.trace, most)
        if of.norm(of.boundary - load) + bound <= most:
            found.add(what)
    if found:
        yield either([Fault(what, measured) for what in sorted(found)])
        return
    yield unexplained(
        "u is not the solution of the discrete problem",
        "the iteration stopped too early, or g or the contact conditions differ",
        measured,
    )


@dataclass(frozen=True, eq=False)
class MeantMultiplier:
    """A way in which a multiplier may have been meant; `fault` says which.

    `load` (nb,) is the boundary load that it is then. `mu` is None where the fault says all, and its
    conditions need not be looked at.
    """

    fault: str
    load: Array
    mu: Trace | None


def readings(mu: Trace, mesh: Mesh, right: Array) -> Iterator[MeantMultiplier]:
    """Other ways to read the multiplier, where u's equation has the `right` load (nb,)."""
    if mu.nodal is None:
        yield from _of_cells(mu, mesh, right)
        return
    mass = boundary_mass(mesh)
    for fault, load in (
        (
            "the multiplier is lumped: its values are reactions over the row sums of the mass matrix",
            mass.sum(axis=1) * mu.nodal,
        ),
        ("the multiplier's values are reactions; hand these in as `reaction`", mu.nodal),
        ("the reactions are values of a multiplier; hand these in as `multiplier`", mass @ (mass @ mu.nodal)),
    ):
        yield MeantMultiplier(fault, np.asarray(load), of_reactions(mesh, np.asarray(load)))


def _of_cells(mu: Trace, mesh: Mesh, right: Array) -> Iterator[MeantMultiplier]:
    divided = constant(mu.cells, mu.values / mu.cells.lengths)
    fault = "the multiplier's values are integrals over the cells; hand in means"
    yield MeantMultiplier(fault, divided.load(mesh), divided)
    for text, moved in moves(mu):
        fault = f"{text}; it has to begin at vertex 0 and run anticlockwise"
        yield MeantMultiplier(fault, moved.load(mesh), moved)
    spread = coupling(mesh, mu.cells) @ (right / boundary_mass(mesh).sum(axis=1))
    as_reactions = of_reactions(mesh, right)
    means = coupling(mesh, mu.cells) @ as_reactions.nodal
    for how, values in (("their shares in the cells", spread), ("the means of their function", means)):
        fault = f"the multiplier is nodal reactions, made {how}; hand in `reaction`"
        other = mu.load(mesh) - constant(mu.cells, values / mu.cells.lengths).load(mesh)
        yield MeantMultiplier(fault, right + other, as_reactions)


def ahead(case: Problem, mu: Trace, of: Residual, right: Array) -> Iterator[MeantMultiplier]:
    """The multiplier after one more step of Uzawa's iteration than u has.

    That is max(0, mu_u - rho times the means of u - g), where mu_u has the `right` load (nb,). The rho > 0 is
    taken that comes nearest.
    """
    boundary = of.discrete.mesh.boundary
    free = ~of.discrete.spaces.condensed.fixed[boundary]
    for each in conditions(case, of.discrete, mu):
        gap = each.means(of.u[boundary])
        mu_u = np.linalg.lstsq(each.B.T.toarray()[free], right[free])[0]
        on = each.mu > ROUNDING * np.abs(each.mu).max()
        if not gap[on].any():
            continue
        rho = -float(gap[on] @ (each.mu - mu_u)[on] / (gap[on] @ gap[on]))
        if rho > 0:
            step = each.B.T @ np.maximum(0, mu_u - rho * gap)
            what = "the iteration stopped too early: the multiplier is one step of Uzawa's ahead of u"
            yield MeantMultiplier(what, right + mu.load(of.discrete.mesh) - step, None)
