"""Which bug explains what u leaves of the equation inside: undoing it leaves a right solution.

A bug adds c times its signature to the equation's residual. With the stiffness matrix K and the mass matrix M

    K u + (1 - c) M u = f       the mass term
    (1 - c) K u + M u = f       the stiffness term
    K u + M u = (1 + c) f       the load, the matrix or u
    K u / 2 + 2 M u = f         areas of triangles that are twice the right ones
    K u + c M u = f             a mass term that is not in the equation, if its coefficient is 0

and c is found by least squares in the dual norm of the hats inside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from unilateral.arrays import Array, Mask
from unilateral.exchange.boundary_function import BoundaryFunction
from unilateral.exchange.equation_residual import Residual, list_candidate_loads
from unilateral.exchange.exported_folder import SAME_PLACE_RATIO
from unilateral.exchange.fault import Fault, describe_wrong_factor
from unilateral.fem.form import Form
from unilateral.fem.p1 import energy_norm, stiffness_and_mass, subtract_lift_from_load
from unilateral.problems.problem import Problem

MAX_UNEXPLAINED_SHARE = 0.1
"""A bug is named if at most this fraction of what is wrong is left without it, 1 % of the square."""
NEGLIGIBLE_RESIDUAL_SHARE = 1e-3
"""Less than this fraction of what may be left is as good as nothing, and not compared."""
RELATIVE_U_ROUNDING = 1e-12
"""Rounding of u leaves at most this fraction of it: EPS (4 n)^(1/2) on n nodes."""
MIN_NONZERO_FACTOR = 1e-6
"""A factor below this counts as 0."""
MIN_RENUMBERING_RATIO = 10
"""u counts as renumbered only if its distance from the right values is more than this many times two others.

These are the distance of both if they are sorted, and that of the right values from the exact ones.
"""


class Repair(NamedTuple):
    """A bug that is undone: its fault, the `residual` without it, and what `repair_multiplier` makes of mu.

    A bug that `needs_multiplier` is one of both u and the multiplier.
    """

    fault: Fault
    residual: Residual
    repair_multiplier: Callable[[BoundaryFunction], BoundaryFunction] = lambda mu: mu
    needs_multiplier: bool = False


def identify_load(
    case: Problem, exported: Residual, mu: Array | None, max_residual: float
) -> tuple[Residual, str]:
    """Residual with the load that u's equation has, and that load's name; the exported one if in doubt.

    Another load has to leave no more than `max_residual` inside, and hardly anything of what the exported one
    leaves. If the exported one leaves more than `max_residual` inside, that is compared inside. Else it is
    compared on V_h, beside the boundary load mu (nb,) of the multiplier, if there is one.
    """
    beside = None if exported.interior_norm > max_residual else mu
    residual_norm = exported.total_norm(beside)
    if residual_norm <= NEGLIGIBLE_RESIDUAL_SHARE * max_residual:
        return exported, ""
    best = (exported, "")
    best_norm = MAX_UNEXPLAINED_SHARE * residual_norm
    for name, load in list_candidate_loads(case.known_solution(), exported.discrete):
        candidate = replace(exported, load=load)
        if (
            np.isfinite(load).all()
            and candidate.interior_norm <= max_residual
            and (residual_norm := candidate.total_norm(beside)) < best_norm
        ):
            best = (candidate, name)
            best_norm = residual_norm
    return best


def list_repairs(case: Problem, residual: Residual, max_residual: float) -> list[Repair]:
    """Bugs without which no more than `max_residual` and hardly anything of the residual is left."""
    threshold = min(max_residual, MAX_UNEXPLAINED_SHARE * residual.interior_norm)
    for _, load in list_candidate_loads(case.known_solution(), residual.discrete):
        if np.isfinite(load).all():  # f may be infinite at nodes
            candidate = Residual(residual.discrete, residual.u, load)
            repairs = [
                repair for repair in _try_bugs(candidate) if repair.residual.interior_norm <= threshold
            ]
            if repairs:
                # those that leave not clearly more than another one does
                smallest = min(repair.residual.interior_norm for repair in repairs)
                cutoff = max(smallest / MAX_UNEXPLAINED_SHARE, NEGLIGIBLE_RESIDUAL_SHARE * threshold)
                return [repair for repair in repairs if repair.residual.interior_norm <= cutoff]
    return list(_try_swapped_axes(residual, threshold))


def _try_bugs(residual: Residual) -> Iterator[Repair]:
    """Each bug of u's equation that is known, undone with the factor that fits best."""
    stiffness, mass = stiffness_and_mass(residual.discrete.mesh)
    K_u = stiffness @ residual.u
    M_u = mass @ residual.u
    if residual.discrete.form.c:
        for term, signature in (("mass term (u, v)", M_u), ("stiffness term (grad u, grad v)", K_u)):
            c = residual.fit_factor(signature)
            without = residual.add_load(c * signature)
            yield Repair(_describe_factor(f"the {term}", 1 - c, signature, without), without)
        # K u / 2 + 2 M u = f, so A u - f = K u / 2 - M u: no factor is left to fit
        areas = 0.5 * K_u - M_u
        detail = "(grad u, grad v) / 2 + 2 (u, v) fits f"
        yield Repair(Fault("the triangles' areas are twice the right ones", detail), residual.add_load(areas))
    else:
        c = residual.fit_factor(M_u)
        fault = Fault("there is a mass term (u, v), but c = 0", f"{-c:.6g} times (u, v)")
        yield Repair(fault, residual.add_load(c * M_u))
    yield from _try_wrong_factors(residual)
    for clamped_fault in find_clamped_fault(residual, 0.0):
        corrected_u = np.where(
            residual.discrete.spaces.condensed.clamped_nodes, residual.discrete.dirichlet_lift, residual.u
        )
        yield Repair(clamped_fault, replace(residual, u=corrected_u))


def _try_wrong_factors(residual: Residual) -> Iterator[Repair]:
    """Bugs that the load, the matrix or u has a wrong factor, if (u, v)_1 = factor (f, v) inside."""
    # A u - f = c f for the factor 1 + c
    factor = 1 + residual.fit_factor(residual.load)
    scaled = Residual(residual.discrete, residual.u, factor * residual.load)
    load = _describe_factor("the load (f, v)", factor, residual.load, scaled)
    yield Repair(load, scaled)
    if _is_missing(factor, residual.load, scaled):
        return
    if factor > 0:
        yield Repair(
            describe_wrong_factor(f"the matrix of {residual.names[0]}", 1 / factor),
            scaled,
            lambda mu: mu.scale(factor),
        )
    divided = Residual(residual.discrete, residual.u / factor, residual.load)
    yield Repair(describe_wrong_factor("u", factor), divided)
    yield Repair(
        describe_wrong_factor("u, like the multiplier,", factor),
        divided,
        lambda mu: mu.scale(1 / factor),
        True,
    )


def _describe_factor(name: str, factor: float, term: Array, residual: Residual) -> Fault:
    """The fault that a term (n,) has a wrong factor, or is missing."""
    if _is_missing(factor, term, residual):
        return Fault(f"{name} is missing", "the equation holds inside without it")
    return describe_wrong_factor(name, factor)


def _is_missing(factor: float, term: Array, residual: Residual) -> bool:
    """Whether the factor of a term (n,) is 0 up to what is left of the residual."""
    size = residual.interior_dual_norm(term)
    return abs(factor) * size <= residual.interior_norm + MIN_NONZERO_FACTOR * size


def _try_swapped_axes(residual: Residual, max_residual: float) -> Iterator[Repair]:
    """The bug that x and y are exchanged, where the mesh is its own mirror image."""
    mesh = residual.discrete.mesh
    distance, node = cKDTree(mesh.points).query(mesh.points[:, ::-1])
    if distance.max() > SAME_PLACE_RATIO * mesh.h:
        return
    mirrored = Residual(residual.discrete, residual.u[node], residual.load)
    if mirrored.interior_norm <= max_residual:
        bug = Fault("x and y are exchanged", "the equation holds inside at (y, x)")
        yield Repair(bug, mirrored, lambda mu: mu.permute_nodes(mesh, node))


def find_clamped_fault(residual: Residual, max_error: float) -> Iterator[Fault]:
    """The fault that u is not u_D on clamped sides, if that alone is an error above `max_error` in H1."""
    # measured in H1 for any c: in |.|_1, the norm for c = 0, a u that is wrong by a constant has no error
    discrete = residual.discrete
    condensed = residual.discrete.spaces.condensed
    mesh = discrete.mesh
    form = discrete.form
    # u - u_D on clamped sides, extended with the least energy: (w, v)_1 = 0 for all v that vanish there
    deviation = np.where(condensed.clamped_nodes, residual.u - discrete.dirichlet_lift, 0.0)
    extension = deviation + condensed.solve(
        subtract_lift_from_load(mesh, form, np.zeros(len(deviation)), deviation)
    )
    if energy_norm(mesh, extension) <= max_error:
        return
    worst = np.abs(deviation).argmax()
    # the clamped sides with an edge on which u differs
    ends = np.abs(deviation[mesh.boundary]) > MIN_NONZERO_FACTOR * abs(deviation[worst])
    sides = np.unique(mesh.side[form.clamped_edges(mesh) & (ends | np.roll(ends, -1))])
    how = _describe_clamped_values(
        residual, np.isin(mesh.side, sides), max_error + RELATIVE_U_ROUNDING * abs(deviation[worst])
    )
    side_list = ", ".join(map(str, sides))
    (x, y) = mesh.points[worst]
    description = f"u is {how} on the clamped side{'s' * (len(sides) > 1)} {side_list}"
    yield Fault(description, f"u - u_D is {deviation[worst]:.2g} at ({x:g}, {y:g})")


def _describe_clamped_values(residual: Residual, edges: Mask, max_residual: float) -> str:
    """Words on u on clamped edges: left free if the equation holds at their inner nodes, or not u_D, or 0."""
    mesh = residual.discrete.mesh
    A = residual.discrete.spaces.condensed.A
    inner = mesh.boundary[(edges & np.roll(edges, 1))]
    every = mesh.boundary[(edges | np.roll(edges, 1))]
    # |(f, phi_j) - (u, phi_j)_1| / ||phi_j||: where u was left free, each free node has its equation
    forces = subtract_lift_from_load(
        mesh, Form(c=residual.discrete.form.c), residual.load, residual.u
    ) / np.sqrt(A.diagonal())
    if inner.size and np.linalg.norm(forces[inner]) <= max_residual:
        return "left free"
    return "not u_D" if residual.u[every].any() else "0, not u_D,"


def find_renumbering(case: Problem, residual: Residual, u_h: Array) -> Fault | None:
    """The fault of another numbering, if the sorted values are nearly those of u_h (n,), else None."""
    # Root mean squares over the nodes. Sorted values are never farther apart than those at the nodes
    # (rearrangement inequality), so the values of a right solution pass, however numbered. Another method may
    # err twice as much as u_h.
    exact = case.known_solution().value_and_gradient(residual.discrete.mesh.points)[0]
    discretisation_error = _root_mean_square(u_h - exact)
    distance = _root_mean_square(residual.u - u_h)
    ordered = _root_mean_square(np.sort(residual.u) - np.sort(u_h))
    if ordered > 2 * discretisation_error or distance <= MIN_RENUMBERING_RATIO * max(
        discretisation_error, ordered
    ):
        return None
    return Fault(
        "the values of u are right, but at other nodes: x, y and u are numbered differently",
        f"u differs from the right values by {distance:.2g}, and by {ordered:.2g} if both are sorted",
    )


def _root_mean_square(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
