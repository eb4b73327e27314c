"""The Ritz projection z_h of a case's solution, and how far u is from it and from any function of V_h.

Everything that needs the interior is computed once per case and mesh, with one pass of quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

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
"""The largest |u| has to lie between these.

Squares of errors down to 1e-3 of it are then normal numbers, and none overflows.
"""


@dataclass(frozen=True, eq=False)
class RitzProjection:
    """A case seen from V_h: its loads, its Ritz projection z_h and how far u is from that.

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

    All cases are solved for at once. Raises InputError for a u so large or small that squares of errors leave
    the range of floating point.
    """
    mesh = condensed.mesh
    boundary = condensed.mesh.boundary
    at_nodes = [case.value_and_gradient(mesh.points)[0] for case in cases]
    for case, values in zip(cases, at_nodes, strict=True):
        _check_u_size(case, float(np.abs(values).max()))
    form = condensed.form
    fixed = condensed.clamped_nodes
    integrals = [integrate_case(case, mesh, v, degree, form) for case, v in zip(cases, at_nodes, strict=True)]
    f = np.array([load for load, _, _, _ in integrals])
    residual = np.array([load for _, load, _, _ in integrals])
    traces = [_evaluate_on_boundary(case, mesh) for case in cases]
    flux = np.array([hat_load(mesh, rule, lambda_values) for rule, _, lambda_values in traces])
    # z_h - lift solves A z = f + lambda - A lift, for all cases at once
    total = f.copy()
    total[:, boundary] += flux
    lift = np.where(fixed, at_nodes, 0.0)
    rows = zip(total, lift, strict=True)
    total = np.array([subtract_lift_from_load(mesh, form, load, row) for load, row in rows])
    residual = np.where(fixed, 0.0, residual)
    flux = np.where(fixed[boundary], 0.0, flux)
    z_h = condensed.solve(total.T).T
    trace_without_lift = z_h[:, boundary]
    z_h += lift
    values = z_h[:, boundary]
    # with d = z_h - r_h u: ||u - z_h||^2 = ||u - r_h u||^2 + (A d - 2 (u - r_h u, .)) d, and the defect is
    # A^{-1} (u - z_h, .) = A^{-1} ((u - r_h u, .) - A d)
    difference = z_h - at_nodes
    A_difference = (condensed.matrix_and_row_sums[0] @ difference.T).T
    defect = condensed.solve((residual - A_difference).T)[boundary].T
    # A^{-1} f on the boundary is z_h, less the lift and A^{-1} lambda
    trace = trace_without_lift - condensed.solve_boundary(flux.T).T
    square_changes = np.sum((A_difference - 2 * residual) * difference, axis=1)
    return [
        RitzProjection(
            case,
            condensed,
            load=f[c],
            multiplier_load=flux[c],
            load_trace=trace[c],
            u_norm=math.sqrt(u_square),
            interpolation_error=math.sqrt(square),
            ritz_error=math.sqrt(max(square + float(square_changes[c]), 0.0)),
            ritz_defect=defect[c],
            boundary_values=values[c],
            ritz_boundary_error=_boundary_distance(mesh, values[c], *traces[c][:2]),
            dirichlet_lift=lift[c],
        )
        for c, (case, (_, _, square, u_square)) in enumerate(zip(cases, integrals, strict=True))
    ]


def _check_u_size(case: ExactSolution, size: float) -> None:
    if size != 0 and not MIN_U_SIZE <= size <= MAX_U_SIZE:
        raise InputError(
            f"case '{case.name}': u is as large as {size:.3g}, and squares of its errors leave the range of "
            f"double precision; scale the data to a size between {MIN_U_SIZE:g} and {MAX_U_SIZE:g}"
        )


def h1_distance(case: ExactSolution, mesh: Mesh, v_h: Array, degree: int | None = None) -> float:
    """||u - v_h||_1 of any v_h (n,) in V_h, by quadrature, part by part of a large mesh."""
    square = 0.0
    for block in mesh_blocks(mesh):
        used = _drop_zero_triangles(case, block, v_h)
        nodal = v_h[used.triangles]
        grad_v = np.einsum("ti,tid->td", nodal, gradients(used))
        for rule in triangle_rules(used, case, degree):
            u, grad_u = _evaluate_at_rule(case.value_and_gradient, rule)
            value, slope = _difference_at_rule(rule, u, grad_u, nodal, grad_v)
            square += _squared_energy(rule.weight, value, slope, Form(c=case.c))
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
    """u - v_h (k, q) and its gradient (k, q, 2) at the rule's points."""
    value = u - np.einsum("kb,kqb->kq", nodal[rule.triangle], rule.barycentric)
    return value, grad_u - grad_v[rule.triangle][:, None]


def _squared_energy(w: Array, value: Array, slope: Array, form: Form) -> float:
    return float(np.sum(w * (form.c * value**2 + form.k * slope[..., 0] ** 2 + form.k * slope[..., 1] ** 2)))


def integrate_case(
    case: ExactSolution, mesh: Mesh, v_h: Array, degree: int | None, form: Form = H1
) -> tuple[Array, Array, float, float]:
    """The loads (f, phi_i) and (u - v_h, phi_i) of a form, and the squared norms of u - v_h and of u."""
    mesh = _drop_zero_triangles(case, mesh, v_h)
    nodal = v_h[mesh.triangles]
    slopes = gradients(mesh)
    grad_v = np.einsum("ti,tid->td", nodal, slopes)
    m = len(mesh.triangles)
    f_moments = np.zeros((m, 3))
    difference_moments = np.zeros((m, 3))
    gradient = np.zeros((m, 2))
    square = u_square = 0.0
    # (u - v_h, phi_i) = int c (u - v_h) phi_i + int k grad (u - v_h) . grad phi_i, constant on triangles
    for rule in triangle_rules(mesh, case, degree):
        w = rule.weight
        phi = rule.barycentric
        u, grad_u, f = _evaluate_at_rule(case.value_gradient_and_source, rule)
        value, slope = _difference_at_rule(rule, u, grad_u, nodal, grad_v)
        u_square += _squared_energy(w, u, grad_u, form)
        square += _squared_energy(w, value, slope, form)
        np.add.at(f_moments, rule.triangle, np.einsum("kq,kqb->kb", w * f, phi))
        np.add.at(difference_moments, rule.triangle, np.einsum("kq,kqb->kb", form.c * w * value, phi))
        np.add.at(gradient, rule.triangle, np.einsum("kq,kqd->kd", form.k * w, slope))
    return load_vector(mesh, f_moments), h1_load(mesh, slopes, difference_moments, gradient), square, u_square


def multiplier_load(case: ExactSolution, mesh: Mesh) -> Array:
    """<lambda, phi_j> (nb,) of the boundary hats."""
    rule, _, flux = _evaluate_on_boundary(case, mesh)
    return hat_load(mesh, rule, flux)


def _evaluate_on_boundary(case: ExactSolution, mesh: Mesh) -> tuple[BoundaryRule, Array, Array]:
    """A rule on the boundary edges, and u and lambda (Q,) at its points."""
    rule = boundary_rule(case.polygon, mesh.s, case.singular_points())
    u, flux, _ = case.trace_flux_and_gap(rule.side, rule.s, rule.nearest_anchor)
    return rule, u, flux


def _boundary_distance(mesh: Mesh, v: Array, rule: BoundaryRule, u: Array) -> float:
    """||u - v||_0 on the boundary, for v linear on the edges with the values (nb,) at their ends."""
    edge = rule.interval
    position = _edge_positions(mesh, rule)
    difference = u - v[edge] * (1 - position) - np.roll(v, -1)[edge] * position
    return math.sqrt(rule.weight @ difference**2)


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
    start = np.bincount(edge, weighted * (1 - position), nb)
    return np.asarray(start + np.roll(np.bincount(edge, weighted * position, nb), 1), dtype=float)
