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
    Conditions,
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
    # 1. which load has u's equation, and does the equation hold inside?
    max_residual = MAX_RESIDUAL_SHARE * reference_errors.h1
    mu = solution.multiplier
    exported = Residual(discrete, solution.u, discrete.load)
    residual, how = identify_load(case, exported, mu.load(discrete.mesh) if mu else None, max_residual)
    holds = residual.interior_norm <= max_residual
    remarks = [LOAD_REMARK.format(how)] if how else []
    # 2. if it does, faults are at the boundary
    boundary_faults = list(_diagnose_boundary(case, mu, residual, reference_errors)) if holds else []
    if holds and all(fault.is_explained for fault in boundary_faults):
        return Diagnosis(boundary_faults, remarks)
    # 3. else, or if something is unexplained: bugs of the equation without which nothing unexplained is left
    if explanation := _explain_by_bugs(case, mu, residual, reference_errors):
        return Diagnosis(explanation, [])
    if holds:
        return Diagnosis(boundary_faults, remarks)
    # 4. else what is left inside is unexplained, unless the nodes are renumbered
    if renumbering := find_renumbering(case, residual, u_h):
        faults = [renumbering]
    else:
        faults = [_describe_residual(residual), *find_clamped_fault(residual, max_residual)]
    return Diagnosis([*faults, *_diagnose_sign(mu, residual, reference_errors)], [])


def _explain_by_bugs(
    case: Problem, mu: BoundaryFunction | None, residual: Residual, reference_errors: Errors
) -> list[Fault]:
    """A bug of the equation and the known ones that are left without it; empty if no bug explains all.

    Of several such bugs those that need the fewest further ones are one fault, joined by "or".
    """
    explanations = []
    for repair in list_repairs(case, residual, MAX_RESIDUAL_SHARE * reference_errors.h1):
        if mu is None and repair.needs_multiplier:
            continue
        repaired_mu = mu and repair.repair_multiplier(mu)
        other_faults = list(_diagnose_boundary(case, repaired_mu, repair.residual, reference_errors))
        if all(fault.is_explained for fault in (repair.fault, *other_faults)):
            explanations.append((repair.fault, other_faults))
    if not explanations:
        return []
    fewest = min(len(other_faults) for _, other_faults in explanations)
    best = [(bug, other_faults) for bug, other_faults in explanations if len(other_faults) == fewest]
    return [merge_alternatives([bug for bug, _ in best]), *best[0][1]]


def _describe_residual(residual: Residual) -> Fault:
    """The fault that the equation does not hold inside, for no reason that is known."""
    x, y = residual.find_worst_place()
    return describe_unknown_fault(
        "the equation does not hold inside the domain",
        "the linear solve stopped too early, the load differs, or u is not a P1 function",
        f"the residual is {residual.interior_norm:.2g} in {residual.names[1]}, and largest at ({x:g}, {y:g})",
    )


def _diagnose_boundary(
    case: Problem, mu: BoundaryFunction | None, residual: Residual, reference_errors: Errors
) -> Iterator[Fault]:
    """Faults on clamped sides, of the multiplier by u's equation, and of its conditions."""
    yield from find_clamped_fault(residual, MAX_RESIDUAL_SHARE * reference_errors.h1)
    if mu is None:
        return
    # ||lambda - mu||_{-1/2,h} for the multiplier lambda that u's equation has, and mu as it was handed in
    max_residual = _max_boundary_residual(residual, reference_errors)
    literal = MultiplierReading("", mu.load(residual.discrete.mesh), mu)
    expected_load = residual.choose_boundary_load(literal.load)
    misfit = residual.boundary_dual_norm(literal.load - expected_load)
    if misfit <= max_residual:
        yield from _diagnose_conditions(case, mu, residual, max_residual)
        return
    # ways in which mu may have been meant, by which it fits; Uzawa's step only where there is no other one
    readings = list(list_readings(mu, residual.discrete.mesh, expected_load))
    uzawa_steps = read_as_uzawa_step(case, mu, residual, expected_load)
    max_distance = min(max_residual, MAX_UNEXPLAINED_SHARE * misfit)

    def fits(candidate: MultiplierReading) -> bool:
        """Whether hardly anything of the misfit is left."""
        return residual.boundary_dual_norm(candidate.load - expected_load) <= max_distance

    if fitting := [*filter(fits, readings)] or [*filter(fits, uzawa_steps)][:1]:
        reading = fitting[0]
        yield merge_alternatives(
            [Fault(candidate.fault, "read in this way it fits u's equation") for candidate in fitting]
        )
    else:
        reading, fit = _find_multiple([literal, *readings], residual, expected_load, max_residual)
        yield from _diagnose_scale(reading.fault, fit, max_residual, *residual.names)
    if reading.mu is not None:
        yield from _diagnose_conditions(case, reading.mu, residual, max_residual)


def _find_multiple(
    readings: list[MultiplierReading], residual: Residual, expected_load: Array, max_residual: float
) -> tuple[MultiplierReading, LoadFit]:
    """The first of the readings that fits u's equation up to a factor, else the first; and its fit."""
    fits = [residual.fit_multiple(reading.load, expected_load) for reading in readings]
    for reading, fit in zip(readings, fits, strict=True):
        if fit.scaled_distance < abs(fit.factor) * max_residual:
            return reading, fit
    return readings[0], fits[0]


def _max_boundary_residual(residual: Residual, reference_errors: Errors) -> float:
    """Residual that may be left at the boundary: an algebraic error, and what is left inside."""
    error = reference_errors.hm12_lower
    if not error > ZERO_ERROR_RATIO * reference_errors.h1:  # lambda is exact, or not judged
        error = reference_errors.h1
    return MAX_RESIDUAL_SHARE * error + residual.interior_norm


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
        expected = f"what u's equation has, to {format_up(fit.scaled_distance / fit.expected_norm, '.1g')}"
        yield describe_wrong_factor("the multiplier", fit.factor, expected)
    elif not reading_fault:
        measured = f"{form} - <lambda, v> - (f, v) is {fit.distance:.2g} in {norm}"
        yield describe_unknown_fault("u and the multiplier do not fit", "", measured)


def _has_wrong_factor(fit: LoadFit, max_residual: float) -> bool:
    """Whether the multiplier surely has the wrong sign, or nothing but a factor is wrong with it."""
    # with mu = t lambda + rest: |t - 1| ||lambda|| is the factor's error, ||rest|| the scaled distance
    factor_error = abs(fit.factor - 1) * fit.expected_norm
    only_factor = fit.scaled_distance < factor_error and fit.scaled_distance <= max(
        abs(fit.factor) * max_residual, MAX_RESIDUAL_SHARE * fit.distance
    )
    return only_factor or fit.factor * fit.expected_norm < -fit.scaled_distance


def _diagnose_sign(
    mu: BoundaryFunction | None, residual: Residual, reference_errors: Errors
) -> Iterator[Fault]:
    """The fault of a wrong sign by the exact multiplier, if it exceeds misfit and this project's error."""
    if mu is None:
        return
    # u's equation does not hold, so that its multiplier is no measure
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
    """The fault of the conditions that u has, if it is not within `max_residual` of any solution for mu."""

    def measure_distance(conditions: Conditions, tolerance: float) -> tuple[float, float]:
        """||u - w|| for the solution w with these conditions, and a bound on the error of the computed w."""
        # ||u - w|| = ||lambda_u - lambda_w||_{-1/2,h}, as the equation holds inside for both
        condensed = residual.discrete.spaces.condensed
        load, bound = conditions.multiplier_load(condensed, residual.unconstrained_trace, tolerance)
        return residual.boundary_dual_norm(residual.boundary_load - load), bound

    correct = []
    distances = {}
    for conditions in list_conditions(case, residual.discrete, mu):
        correct.append(conditions)
        # the error of w is taken off: u is blamed only for what is surely wrong
        computed, bound = measure_distance(conditions, max_residual)
        distances[conditions.description] = computed - bound
        if distances[conditions.description] <= max_residual:
            return
    nearest = min(distances, key=lambda description: distances[description])
    max_distance = min(max_residual, MAX_UNEXPLAINED_SHARE * distances[nearest])
    distance = f"at least {format_down(distances[nearest], '.2g')} in {residual.names[1]}"
    measured = f"u is {distance} away from the solution with u >= g {nearest}"
    # and the same for conditions that authors take by mistake, with the error added
    descriptions = set()
    for description, conditions in list_mistaken_conditions(
        case, residual.discrete, mu, correct, residual.u[residual.discrete.mesh.boundary]
    ):
        if sum(measure_distance(conditions, max_distance)) <= max_distance:
            descriptions.add(description)
    if descriptions:
        yield merge_alternatives([Fault(description, measured) for description in sorted(descriptions)])
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
    """Other ways to read a multiplier that was handed in as constant on cells."""
    divided = piecewise_constant(mu.partition, mu.values / mu.partition.lengths)
    fault = "the multiplier's values are integrals over the cells; hand in means"
    yield MultiplierReading(fault, divided.load(mesh), divided)
    for text, shifted in list_arc_length_shifts(mu):
        fault = f"{text}; it has to begin at vertex 0 and run anticlockwise"
        yield MultiplierReading(fault, shifted.load(mesh), shifted)
    # reactions r_j made means: sum_j B_ij r_j / <1, phi_j> over H_i, or those of the P1 function of r
    spread = coupling(mesh, mu.partition) @ (expected_load / boundary_mass(mesh).sum(axis=1))
    as_reactions = represent_reactions(mesh, expected_load)
    means = coupling(mesh, mu.partition) @ as_reactions.nodal_values
    for how, values in (("their shares in the cells", spread), ("the means of their function", means)):
        fault = f"the multiplier is nodal reactions, made {how}; hand in `reaction`"
        means_function = piecewise_constant(mu.partition, values / mu.partition.lengths)
        difference = mu.load(mesh) - means_function.load(mesh)
        yield MultiplierReading(fault, expected_load + difference, as_reactions)


def read_as_uzawa_step(
    case: Problem, mu: BoundaryFunction, residual: Residual, expected_load: Array
) -> Iterator[MultiplierReading]:
    """The multiplier after one more step of Uzawa's iteration than u has.

    That is max(0, mu_u - rho times the means of u - g), where mu_u has the `expected_load` load (nb,). The
    rho > 0 is taken that comes nearest.
    """
    boundary = residual.discrete.mesh.boundary
    free = ~residual.discrete.spaces.condensed.clamped_nodes[boundary]
    for conditions in list_conditions(case, residual.discrete, mu):
        # mu_u by least squares from its load B^T mu_u
        gap = conditions.gaps(residual.u[boundary])
        mu_u = np.linalg.lstsq(conditions.B.T.toarray()[free], expected_load[free])[0]
        active = conditions.mu > ZERO_VALUE_RATIO * np.abs(conditions.mu).max()
        if not gap[active].any():
            continue
        # where mu > 0, (5.2) says mu - mu_u = -rho gap: rho by least squares
        rho = -float(gap[active] @ (conditions.mu - mu_u)[active] / (gap[active] @ gap[active]))
        if rho > 0:
            step = conditions.B.T @ np.maximum(0, mu_u - rho * gap)
            description = "the iteration stopped too early: the multiplier is one step of Uzawa's ahead of u"
            yield MultiplierReading(description, expected_load + mu.load(residual.discrete.mesh) - step, None)
