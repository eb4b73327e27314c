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
from unilateral.exchange.boundary_function import BoundaryFunction, piecewise_constant, represent_reactions
from unilateral.exchange.discrete_conditions import (
    ZERO_VALUE_RATIO,
    list_arc_length_shifts,
    list_conditions,
    list_mistaken_conditions,
)
from unilateral.exchange.equation_bugs import (
    MAX_UNEXPLAINED_SHARE,
    find_clamped_fault,
    find_renumbering,
    identify_load,
    list_repairs,
)
from unilateral.exchange.equation_residual import LoadFit, Residual, exact_multiplier_load
from unilateral.exchange.exported_folder import ForeignSolution
from unilateral.exchange.fault import Fault, describe_unknown_fault, describe_wrong_factor, merge_alternatives
from unilateral.fem.p1 import boundary_mass, coupling
from unilateral.formulas.decimals import format_down, format_up
from unilateral.geometry.mesh import Mesh
from unilateral.norms.dual import Errors
from unilateral.problems.problem import Problem
from unilateral.solvers.stop import Stop

MAX_RESIDUAL_SHARE = Stop.fraction
"""What is left counts if it exceeds this fraction of this project's error on the same level.

Up to there a rate over a factor of 2 changes by 0.03 at most.
"""
ZERO_ERROR_RATIO = 1e-10
"""An error of lambda below this fraction of the error of u counts as 0."""
LOAD_REMARK = "the load is that of f {}; its error adds to yours, and is no fault"


class Diagnosis(NamedTuple):
    """What is wrong with a solution, and what is not, but worth knowing."""

    faults: list[Fault]
    remarks: list[str]


def diagnose_solution(
    case: Problem, solution: ForeignSolution, discrete: CondensedProblem, reference_errors: Errors, u_h: Array
) -> Diagnosis:
    """Faults and remarks of a solution, by what it leaves of the equations that it claims to solve.

    A bug inside is told only if without it, and without further known bugs of the multiplier or the
    conditions, a right solution is left. Of several such bugs those are told that need the fewest further
    ones.
    """
    allowed = MAX_RESIDUAL_SHARE * reference_errors.h1
    mu = solution.multiplier
    exported = Residual(discrete, solution.u, discrete.load)
    of, how = identify_load(case, exported, mu.load(discrete.mesh) if mu else None, allowed)
    holds = of.interior_norm <= allowed
    remarks = [LOAD_REMARK.format(how)] if how else []
    found = list(_diagnose_boundary(case, mu, of, reference_errors)) if holds else []
    if holds and all(each.is_explained for each in found):
        return Diagnosis(found, remarks)
    told = [
        [
            each.fault,
            *_diagnose_boundary(case, mu and each.repair_multiplier(mu), each.residual, reference_errors),
        ]
        for each in list_repairs(case, of, allowed)
        if mu is not None or not each.needs_multiplier
    ]
    told = [each for each in told if all(fault.is_explained for fault in each)]
    if told:
        fewest = min(map(len, told))
        best = [each for each in told if len(each) == fewest]
        return Diagnosis([merge_alternatives([each[0] for each in best]), *best[0][1:]], [])
    if holds:
        return Diagnosis(found, remarks)
    other = find_renumbering(case, of, u_h)
    faults = [other] if other else [_interior_fault(of), *find_clamped_fault(of, allowed)]
    return Diagnosis([*faults, *_diagnose_sign(mu, of, reference_errors)], [])


def _interior_fault(residual: Residual) -> Fault:
    x, y = residual.find_worst_place()
    return describe_unknown_fault(
        "the equation does not hold inside the domain",
        "the linear solve stopped too early, the load is another one, or u is not meant as P1",
        f"the residual is {residual.interior_norm:.2g} in {residual.names[1]}, and largest at ({x:g}, {y:g})",
    )


def _diagnose_boundary(
    case: Problem, mu: BoundaryFunction | None, residual: Residual, reference_errors: Errors
) -> Iterator[Fault]:
    """Faults on clamped sides, of the multiplier by u's equation, and of its conditions."""
    yield from find_clamped_fault(residual, MAX_RESIDUAL_SHARE * reference_errors.h1)
    if mu is None:
        return
    allowed = _max_boundary_residual(residual, reference_errors)
    first = MultiplierReading("", mu.load(residual.discrete.mesh), mu)
    right = residual.choose_boundary_load(first.load)
    misfit = residual.boundary_dual_norm(first.load - right)
    if misfit <= allowed:
        yield from _diagnose_conditions(case, mu, residual, allowed)
        return
    most = min(allowed, MAX_UNEXPLAINED_SHARE * misfit)
    others = list(list_readings(mu, residual.discrete.mesh, right))
    meant = [each for each in others if residual.boundary_dual_norm(each.load - right) <= most] or [
        each
        for each in read_as_uzawa_step(case, mu, residual, right)
        if residual.boundary_dual_norm(each.load - right) <= most
    ][:1]
    if meant:
        yield merge_alternatives(
            [Fault(each.fault, "read in this way it fits u's equation") for each in meant]
        )
        reading = meant[0]
    else:
        fits = ((each, residual.fit_multiple(each.load, right)) for each in (first, *others))
        reading = next((each for each, fit in fits if fit.scaled_distance < abs(fit.factor) * allowed), first)
        yield from _diagnose_scale(
            reading.fault, residual.fit_multiple(reading.load, right), allowed, *residual.names
        )
    if reading.mu is not None:
        yield from _diagnose_conditions(case, reading.mu, residual, allowed)


def _max_boundary_residual(residual: Residual, reference_errors: Errors) -> float:
    """How much may be left at the boundary."""
    return (
        MAX_RESIDUAL_SHARE
        * (
            reference_errors.hm12_lower
            if reference_errors.hm12_lower > ZERO_ERROR_RATIO * reference_errors.h1
            else reference_errors.h1
        )
        + residual.interior_norm
    )


def _diagnose_scale(
    reading_fault: str, fit: LoadFit, max_residual: float, form: str, norm: str
) -> Iterator[Fault]:
    """The faults of a multiplier that has not the right scale, if it was meant as in a reading."""
    if reading_fault:
        yield Fault(reading_fault, "read in this way it fits u's equation up to a factor")
    if fit.factor == fit.scaled_distance == 0:
        yield Fault(
            "the multiplier is 0 everywhere, but that of u's equation is not",
            f"its norm is {fit.expected_norm:.2g}",
        )
    elif _has_wrong_factor(fit, max_residual):
        right = f"what u's equation has, to {format_up(fit.scaled_distance / fit.expected_norm, '.1g')}"
        yield describe_wrong_factor("the multiplier", fit.factor, right)
    elif not reading_fault:
        measured = f"{form} - <lambda, v> - (f, v) is {fit.distance:.2g} in {norm}"
        yield describe_unknown_fault("u and the multiplier do not fit", "", measured)


def _has_wrong_factor(fit: LoadFit, max_residual: float) -> bool:
    """Whether the multiplier surely has the wrong sign, or nothing but a factor is wrong with it."""
    of_factor = abs(fit.factor - 1) * fit.expected_norm
    only = fit.scaled_distance < of_factor and fit.scaled_distance <= max(
        abs(fit.factor) * max_residual, MAX_RESIDUAL_SHARE * fit.distance
    )
    return only or fit.factor * fit.expected_norm < -fit.scaled_distance


def _diagnose_sign(
    mu: BoundaryFunction | None, residual: Residual, reference_errors: Errors
) -> Iterator[Fault]:
    """A wrong sign by the exact multiplier, if it is surer than what is left and this project's error."""
    if mu is None:
        return
    fit = residual.fit_multiple(mu.load(residual.discrete.mesh), exact_multiplier_load(residual.discrete))
    uncertain = fit.scaled_distance + reference_errors.hm12_upper
    if fit.factor * fit.expected_norm < -uncertain:
        yield describe_wrong_factor(
            "the multiplier",
            fit.factor,
            f"the exact one, to {format_up(uncertain / fit.expected_norm, '.1g')}",
        )


def _diagnose_conditions(
    case: Problem, mu: BoundaryFunction, residual: Residual, max_residual: float
) -> Iterator[Fault]:
    """The other conditions that u has, if it has none of those that belong to mu."""
    right = []
    missed = {}
    for each in list_conditions(case, residual.discrete, mu):
        right.append(each)
        load, bound = each.multiplier_load(
            residual.discrete.spaces.condensed, residual.unconstrained_trace, max_residual
        )
        missed[each.description] = residual.boundary_dual_norm(residual.boundary_load - load) - bound
        if missed[each.description] <= max_residual:
            return
    nearest = min(missed, key=lambda what: missed[what])
    most = min(max_residual, MAX_UNEXPLAINED_SHARE * missed[nearest])
    distance = f"at least {format_down(missed[nearest], '.2g')} in {residual.names[1]}"
    measured = f"u is {distance} away from the solution with u >= g {nearest}"
    found = set()
    for what, each in list_mistaken_conditions(
        case, residual.discrete, mu, right, residual.u[residual.discrete.mesh.boundary]
    ):
        load, bound = each.multiplier_load(
            residual.discrete.spaces.condensed, residual.unconstrained_trace, most
        )
        if residual.boundary_dual_norm(residual.boundary_load - load) + bound <= most:
            found.add(what)
    if found:
        yield merge_alternatives([Fault(what, measured) for what in sorted(found)])
        return
    yield describe_unknown_fault(
        "u is not the solution of the discrete problem",
        "the iteration stopped too early, or g or the contact conditions differ",
        measured,
    )


@dataclass(frozen=True, eq=False)
class MultiplierReading:
    """A way in which a multiplier may have been meant; `fault` says which.

    `load` (nb,) is the boundary load that it is then. `mu` is None where the fault says all, and its
    conditions need not be looked at.
    """

    fault: str
    load: Array
    mu: BoundaryFunction | None


def list_readings(mu: BoundaryFunction, mesh: Mesh, expected_load: Array) -> Iterator[MultiplierReading]:
    """Other ways to read the multiplier, where u's equation has the `expected_load` load (nb,)."""
    if mu.nodal_values is None:
        yield from _list_cell_readings(mu, mesh, expected_load)
        return
    mass = boundary_mass(mesh)
    for fault, load in (
        (
            "the multiplier is lumped: its values are reactions over the row sums of the mass matrix",
            mass.sum(axis=1) * mu.nodal_values,
        ),
        ("the multiplier's values are reactions; hand these in as `reaction`", mu.nodal_values),
        (
            "the reactions are values of a multiplier; hand these in as `multiplier`",
            mass @ (mass @ mu.nodal_values),
        ),
    ):
        yield MultiplierReading(fault, np.asarray(load), represent_reactions(mesh, np.asarray(load)))


def _list_cell_readings(
    mu: BoundaryFunction, mesh: Mesh, expected_load: Array
) -> Iterator[MultiplierReading]:
    divided = piecewise_constant(mu.partition, mu.values / mu.partition.lengths)
    fault = "the multiplier's values are integrals over the cells; hand in means"
    yield MultiplierReading(fault, divided.load(mesh), divided)
    for text, moved in list_arc_length_shifts(mu):
        fault = f"{text}; it has to begin at vertex 0 and run anticlockwise"
        yield MultiplierReading(fault, moved.load(mesh), moved)
    spread = coupling(mesh, mu.partition) @ (expected_load / boundary_mass(mesh).sum(axis=1))
    as_reactions = represent_reactions(mesh, expected_load)
    means = coupling(mesh, mu.partition) @ as_reactions.nodal_values
    for how, values in (("their shares in the cells", spread), ("the means of their function", means)):
        fault = f"the multiplier is nodal reactions, made {how}; hand in `reaction`"
        other = mu.load(mesh) - piecewise_constant(mu.partition, values / mu.partition.lengths).load(mesh)
        yield MultiplierReading(fault, expected_load + other, as_reactions)


def read_as_uzawa_step(
    case: Problem, mu: BoundaryFunction, residual: Residual, expected_load: Array
) -> Iterator[MultiplierReading]:
    """The multiplier after one more step of Uzawa's iteration than u has.

    That is max(0, mu_u - rho times the means of u - g), where mu_u has the `expected_load` load (nb,). The
    rho > 0 is taken that comes nearest.
    """
    boundary = residual.discrete.mesh.boundary
    free = ~residual.discrete.spaces.condensed.clamped_nodes[boundary]
    for each in list_conditions(case, residual.discrete, mu):
        gap = each.gaps(residual.u[boundary])
        mu_u = np.linalg.lstsq(each.B.T.toarray()[free], expected_load[free])[0]
        on = each.mu > ZERO_VALUE_RATIO * np.abs(each.mu).max()
        if not gap[on].any():
            continue
        rho = -float(gap[on] @ (each.mu - mu_u)[on] / (gap[on] @ gap[on]))
        if rho > 0:
            step = each.B.T @ np.maximum(0, mu_u - rho * gap)
            what = "the iteration stopped too early: the multiplier is one step of Uzawa's ahead of u"
            yield MultiplierReading(what, expected_load + mu.load(residual.discrete.mesh) - step, None)
