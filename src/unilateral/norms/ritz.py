"""The Ritz projection z_h of a case's solution, and how far u is from it and from any function of V_h.

Everything that needs the interior is computed once per case and mesh, with one pass of quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.condense import CondensedMatrix
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import gradients, h1_load, load_vector, mesh_blocks, subtract_lift_from_load
from unilateral.fem.quadrature import BoundaryRule, TriangleRule, boundary_rule, triangle_rules
from unilateral.geometry.mesh import Mesh

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution

MIN_U_SIZE = 1e-152
MAX_U_SIZE = 1e152
"""The largest |u| lies between these: no square of an error from 1e-3 of it on is denormal or overflows."""


@dataclass(frozen=True, eq=False)
class RitzProjection:
    """A case seen from V_h: its loads, its Ritz projection z_h and how far u is from z_h.

    `load` (n,) is (f, phi_i); `multiplier_load` (nb,) is <lambda, phi_j>; `load_trace` (nb,) is A^{-1} f on
    the boundary; `ritz_error` is ||u - z_h||_1 and `ritz_defect` (nb,) is A^{-1} (u - z_h, phi_i)_1 on the
    boundary, which is only quadrature's error; `interpolation_error` is ||u - r_h u||_1 of (4.14). On the
    boundary z_h has the `boundary_values` (nb,), and `ritz_boundary_error` is ||u - z_h||_0 there. On clamped
    sides z_h is u at the nodes, `dirichlet_lift` (n,). Norms are those of the form, and loads are 0 at fixed
    nodes but for that of f.
    """

    case: ExactSolution
    condensed: CondensedMatrix
    load: Array
    multiplier_load: Array
    load_trace: Array
    u_norm: float
    interpolation_error: float
    ritz_error: float
    ritz_defect: Array
    boundary_values: Array
    ritz_boundary_error: float
    dirichlet_lift: Array

    def discrete_dual_norm(self, boundary_load: Array) -> float:
        """||mu||_{-1/2,h} = sup over V_h of <mu, v>/||v||_1, from the values <mu, phi_j> (nb,)."""
        half = solve_triangular(self.condensed.cholesky, boundary_load, trans="T", check_finite=False)
        return float(np.linalg.norm(half))

    def h1_and_dual_errors(self, boundary_load: Array) -> tuple[float, float, float]:
        """||u - u_h||_1, quadrature's share of its square, and ||lambda - lambda_H||_{-1/2,h}.

        They are computed from the values <lambda - lambda_H, phi_j> (nb,).
        """
        dual = self.discrete_dual_norm(boundary_load)
        share = 2 * float(self.ritz_defect @ boundary_load)
        square = self.ritz_error**2 + share + dual**2
        return math.sqrt(max(square, 0.0)), abs(share) / square if square > 0 else 0.0, dual


def ritz_projection(
    case: ExactSolution, condensed: CondensedMatrix, degree: int | None = None
) -> RitzProjection:
    """The projection of one case, see `ritz_projections`."""
    return ritz_projections([case], condensed, degree)[0]


def ritz_projections(
    cases: Sequence[ExactSolution], condensed: CondensedMatrix, degree: int | None = None
) -> list[RitzProjection]:
    """The projections and their errors, with quadrature of that degree in Omega, see `triangle_rules`.

    All cases are solved for at once. Raises InputError for a u that is too large or too small.
    """
    mesh = condensed.mesh
    nodal_values = [case.value_and_gradient(mesh.points)[0] for case in cases]
    for case, values in zip(cases, nodal_values, strict=True):
        _check_u_size(case, float(np.abs(values).max()))
    integrals = [
        integrate_case(case, mesh, values, degree, condensed.form)
        for case, values in zip(cases, nodal_values, strict=True)
    ]
    traces = [_evaluate_on_boundary(case, mesh) for case in cases]
    flux = np.where(condensed.clamped_nodes[mesh.boundary], 0.0, [item.load for item in traces])
    lift = np.where(condensed.clamped_nodes, nodal_values, 0.0)
    z_h, load_trace = _solve_for_projections(condensed, integrals, flux, lift)
    square_changes, defect = _compare_with_interpolation(condensed, integrals, z_h - nodal_values)
    boundary_values = z_h[:, mesh.boundary]
    return [
        RitzProjection(
            case,
            condensed,
            load=integrals[c].f_load,
            multiplier_load=flux[c],
            load_trace=load_trace[c],
            u_norm=math.sqrt(integrals[c].u_square),
            interpolation_error=math.sqrt(integrals[c].difference_square),
            ritz_error=math.sqrt(max(integrals[c].difference_square + float(square_changes[c]), 0.0)),
            ritz_defect=defect[c],
            boundary_values=boundary_values[c],
            ritz_boundary_error=_boundary_distance(mesh, boundary_values[c], traces[c]),
            dirichlet_lift=lift[c],
        )
        for c, case in enumerate(cases)
    ]


def _solve_for_projections(
    condensed: CondensedMatrix, integrals: Sequence[CaseIntegrals], flux: Array, lift: Array
) -> tuple[Array, Array]:
    """The Ritz projections z_h (k, n) of k cases, and A^{-1} f on the boundary (k, nb).

    `flux` (k, nb) are the loads of lambda, `lift` (k, n) the Dirichlet lifts.
    """
    boundary = condensed.mesh.boundary
    # z_h - lift solves A z = f + lambda - A lift
    total = np.array([item.f_load for item in integrals])
    total[:, boundary] += flux
    rows = zip(total, lift, strict=True)
    total = np.array([subtract_lift_from_load(condensed.mesh, condensed.form, *row) for row in rows])
    z_h = condensed.solve(total.T).T
    # A^{-1} f on the boundary is z_h, less the lift and A^{-1} lambda
    load_trace = z_h[:, boundary] - condensed.solve_boundary(flux.T).T
    z_h += lift
    return z_h, load_trace


def _compare_with_interpolation(
    condensed: CondensedMatrix, integrals: Sequence[CaseIntegrals], d: Array
) -> tuple[Array, Array]:
    """||u - z_h||^2 - ||u - r_h u||^2 (k,), and the `ritz_defect` A^{-1} (u - z_h, phi_i) (k, nb).

    `d` (k, n) is z_h - r_h u; r_h u, the interpolation of u at the nodes, is the v_h of the `integrals`.
    """
    residual = np.where(condensed.clamped_nodes, 0.0, [item.difference_load for item in integrals])
    A_d = (condensed.matrix_and_row_sums[0] @ d.T).T
    # ||u - z_h||^2 = ||u - r_h u||^2 + (A d - 2 (u - r_h u, .)) d
    square_changes = np.sum((A_d - 2 * residual) * d, axis=1)
    # A^{-1} (u - z_h, .) = A^{-1} ((u - r_h u, .) - A d)
    return square_changes, condensed.solve((residual - A_d).T)[condensed.mesh.boundary].T


def _check_u_size(case: ExactSolution, size: float) -> None:
    if size != 0 and not MIN_U_SIZE <= size <= MAX_U_SIZE:
        raise InputError(
            f"case '{case.name}': u is as large as {size:.3g}, and squares of its errors leave the range of "
            f"double precision; scale the data to a size between {MIN_U_SIZE:g} and {MAX_U_SIZE:g}"
        )


def h1_distance(case: ExactSolution, mesh: Mesh, v_h: Array, degree: int | None = None) -> float:
    """||u - v_h||_1 of any v_h (n,) in V_h, by quadrature, part by part of a large mesh."""
    return _energy_distance(case, mesh, v_h, Form(c=case.c), degree)  # cases have k = 1


def l2_distance(case: ExactSolution, mesh: Mesh, v_h: Array, degree: int | None = None) -> float:
    """||u - v_h||_0 in Omega of any v_h (n,) in V_h, by quadrature, part by part of a large mesh."""
    return _energy_distance(case, mesh, v_h, Form(k=0.0, c=1.0), degree)


def _energy_distance(case: ExactSolution, mesh: Mesh, v_h: Array, form: Form, degree: int | None) -> float:
    square = 0.0
    for block in mesh_blocks(mesh):
        used = _drop_zero_triangles(case, block, v_h)
        nodal = v_h[used.triangles]
        grad_v = np.einsum("ti,tid->td", nodal, gradients(used))
        for rule in triangle_rules(used, case, degree):
            u, grad_u = _evaluate_at_rule(case.value_and_gradient, rule)
            value, slope = _difference_at_rule(rule, u, grad_u, nodal, grad_v)
            square += _squared_energy(rule.weight, value, slope, form)
    return math.sqrt(square)


def _drop_zero_triangles(case: ExactSolution, mesh: Mesh, v_h: Array) -> Mesh:
    """The mesh without the triangles on which u and v_h are 0."""
    zero = case.vanishes_in_circles(*mesh.enclosing_circles) & ~v_h[mesh.triangles].any(axis=1)
    return mesh.select_triangles(np.flatnonzero(~zero)) if zero.any() else mesh


def _evaluate_at_rule(functions: Callable[..., tuple[Array, ...]], rule: TriangleRule) -> list[Array]:
    """Functions of places, such as u and grad u, at the rule's points: (k, q), (k, q, 2)."""
    w = rule.weight
    return [values.reshape(*w.shape, *values.shape[1:]) for values in functions(rule.origin, rule.offset)]


def _difference_at_rule(
    rule: TriangleRule, u: Array, grad_u: Array, nodal: Array, grad_v: Array
) -> tuple[Array, Array]:
    """u - v_h (k, q) and its gradient (k, q, 2) at the rule's points.

    On each triangle v_h has the values `nodal` (m, 3) at the corners, and the gradient `grad_v` (m, 2).
    """
    value = u - np.einsum("kb,kqb->kq", nodal[rule.triangle], rule.barycentric)
    return value, grad_u - grad_v[rule.triangle][:, None]


def _squared_energy(w: Array, value: Array, slope: Array, form: Form) -> float:
    return float(np.sum(w * (form.c * value**2 + form.k * slope[..., 0] ** 2 + form.k * slope[..., 1] ** 2)))


class CaseIntegrals(NamedTuple):
    """(f, phi_i) and (u - v_h, phi_i) in the form's inner product, (n,); ||u - v_h||^2 and ||u||^2."""

    f_load: Array
    difference_load: Array
    difference_square: float
    u_square: float


def integrate_case(
    case: ExactSolution, mesh: Mesh, v_h: Array, degree: int | None, form: Form = H1
) -> CaseIntegrals:
    """The integrals of a case and a function v_h (n,) of V_h, by quadrature of that degree."""
    mesh = _drop_zero_triangles(case, mesh, v_h)
    nodal = v_h[mesh.triangles]
    slopes = gradients(mesh)
    grad_v = np.einsum("ti,tid->td", nodal, slopes)
    f_moments = np.zeros(nodal.shape)
    difference_moments = np.zeros(nodal.shape)
    gradient = np.zeros(grad_v.shape)  # integrals of k grad (u - v_h)
    square = u_square = 0.0
    # (u - v_h, phi_i) = int c (u - v_h) phi_i + int k grad (u - v_h) . grad phi_i, constant on triangles
    for rule in triangle_rules(mesh, case, degree):
        u, grad_u, f = _evaluate_at_rule(case.value_gradient_and_source, rule)
        value, slope = _difference_at_rule(rule, u, grad_u, nodal, grad_v)
        u_square += _squared_energy(rule.weight, u, grad_u, form)
        square += _squared_energy(rule.weight, value, slope, form)
        np.add.at(f_moments, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
        np.add.at(
            difference_moments,
            rule.triangle,
            np.einsum("kq,kqb->kb", form.c * rule.weight * value, rule.barycentric),
        )
        np.add.at(gradient, rule.triangle, np.einsum("kq,kqd->kd", form.k * rule.weight, slope))
    return CaseIntegrals(
        load_vector(mesh, f_moments), h1_load(mesh, slopes, difference_moments, gradient), square, u_square
    )


def multiplier_load(case: ExactSolution, mesh: Mesh) -> Array:
    """<lambda, phi_j> (nb,) of the boundary hats."""
    return _evaluate_on_boundary(case, mesh).load


class _BoundaryTrace(NamedTuple):
    """A rule on the boundary edges, u (Q,) at its points, and the load <lambda, phi_j> (nb,)."""

    rule: BoundaryRule
    u: Array
    load: Array


def _evaluate_on_boundary(case: ExactSolution, mesh: Mesh) -> _BoundaryTrace:
    """The trace and the load of a case, by quadrature that is split at its singular points."""
    rule = boundary_rule(case.polygon, mesh.s, case.singular_points())
    u, flux, _ = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)
    return _BoundaryTrace(rule, u, hat_load(mesh, rule, flux))


def _boundary_distance(mesh: Mesh, v: Array, trace: _BoundaryTrace) -> float:
    """||u - v||_0 on the boundary, for v linear on the edges with the values (nb,) at their ends."""
    edge = trace.rule.interval
    position = _edge_positions(mesh, trace.rule)
    difference = trace.u - v[edge] * (1 - position) - np.roll(v, -1)[edge] * position
    return math.sqrt(trace.rule.weight @ difference**2)


def _edge_positions(mesh: Mesh, rule: BoundaryRule) -> Array:
    """Where the points of a rule lie in their edges, from 0 to 1, (Q,)."""
    start = mesh.s[rule.interval] - mesh.polygon.starts[rule.side]
    return np.asarray((rule.s - start) / np.diff(mesh.s)[rule.interval])


def hat_load(mesh: Mesh, rule: BoundaryRule, values: Array) -> Array:
    """<mu, phi_j> (nb,) for the values (Q,) of mu at the points of a rule whose intervals are the edges."""
    edge = rule.interval
    nb = len(mesh.boundary)
    position = _edge_positions(mesh, rule)
    weighted = rule.weight * values
    # edge e has parts of two hats: 1 - position of node e, position of node e + 1
    start = np.bincount(edge, weighted * (1 - position), nb)
    return np.asarray(start + np.roll(np.bincount(edge, weighted * position, nb), 1), dtype=float)
