"""What sections 1, 3 and 4 of the paper say of its problem and its forms, tried on one mesh.

Beside each number is the same one for a spoilt input, `..._elsewhere`, for which the statement is false.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr
from scipy.linalg import solve

from study.experiments.algorithm.measure import N_DIRECTIONS, SolvedCase, solve_cases
from unilateral.arrays import Array
from unilateral.fem.p1 import gradients
from unilateral.fem.quadrature import symmetric_rule
from unilateral.fem.spaces import MixedSpaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.ritz import integrate_case
from unilateral.problems.case import ExactSolution

FLUX_RULE_DEGREE = 12
"""The degree of the quadrature rule for the solution with the flux 1, which is an entire function."""
GAP_POINTS_PER_EDGE = 17
"""The gap is evaluated at so many points of an edge, its ends included."""


def measure_formulation(mesh: Mesh, partition: Partition, cases: Sequence[ExactSolution]) -> xr.Dataset:
    """How well u satisfies (1.5) and the first equation of (P*), and u_h (3.2), over the cases.

    The numbers of the spaces alone are for (4.3), the constant M of (4.2) and, for the flux 1 on the unit
    square, (3.7).
    """
    rng = np.random.default_rng(0)
    rows = []
    for solved in solve_cases(mesh, partition, cases):
        in_K = _measure_minimum(solved, solved.lambda_H, "") | _measure_minimum(
            solved, solved.lambda_H + 1, "_elsewhere"
        )
        rows.append(_measure_weak_form(solved, rng) | in_K)
    space_numbers = _measure_forms(solved.spaces, rng) | _measure_galerkin(solved.spaces)
    table = {name: ("case", [row[name] for row in rows]) for name in rows[0]}
    space_variables = {name: ((), value) for name, value in space_numbers.items()}
    return xr.Dataset({**table, **space_variables}, {"case": [case.name for case in cases]})


def _measure_weak_form(solved_case: SolvedCase, rng: np.random.Generator) -> dict[str, float]:
    """The residual of (P*) in the dual norm of V_h, and the least (u, v - u)_1 - (f, v - u)_0 of (1.5).

    The residual is relative to ||u||_1, and `..._elsewhere` without the flux. The least is relative to
    ||u||_1 ||w||_1 for v = u + w, with w in V_h as small on the boundary as v >= g allows, or larger, and
    `..._elsewhere` with -w.
    """
    spaces = solved_case.spaces
    case = solved_case.exact.ritz.case
    boundary = solved_case.spaces.mesh.boundary
    # (f, phi_i)_0, (u, phi_i)_1 and ||u||_1^2; the slack less <lambda, phi_i> is the residual of (P*)
    load, u_products, _, square = integrate_case(case, spaces.mesh, np.zeros(spaces.mesh.n_nodes), None)
    slack = u_products - load
    residual = slack.copy()
    residual[boundary] -= solved_case.exact.ritz.multiplier_load
    size = float(np.sqrt(square))
    # v = u + w is in K where w >= g - u at the boundary; (1.5) says that no w has a negative value
    w = rng.standard_normal((N_DIRECTIONS, len(slack)))
    boundary_excess = rng.random((N_DIRECTIONS, len(boundary))) * rng.integers(2, size=(N_DIRECTIONS, 1))
    w[:, boundary] = boundary_excess - _smallest_gaps(case, spaces.mesh)
    values = w @ slack / (size * np.sqrt(np.sum(w.T * (spaces.condensed.A @ w.T), axis=0)))
    return {
        "equation": _discrete_dual_norm(spaces, residual) / size,
        "equation_elsewhere": _discrete_dual_norm(spaces, slack) / size,
        "minimum": float(values.min()),
        "minimum_elsewhere": float((-values).min()),
    }


def _discrete_dual_norm(spaces: MixedSpaces, values: Array) -> float:
    """sup over V_h of r(v)/||v||_1 from the values r(phi_i) (n,)."""
    return float(np.sqrt(values @ spaces.condensed.solve(values)))


def _smallest_gaps(case: ExactSolution, mesh: Mesh) -> Array:
    """The least gap u - g on both edges at each boundary node (nb,)."""
    polygon = mesh.polygon
    ends = mesh.s
    side = np.searchsorted(polygon.starts, 0.5 * (ends[1:] + ends[:-1])) - 1
    s = ends[:-1] - polygon.starts[side] + np.linspace(0, 1, GAP_POINTS_PER_EDGE)[:, None] * np.diff(ends)
    edge_gaps = case.gap(np.tile(side, GAP_POINTS_PER_EDGE), s.ravel()).reshape(s.shape).min(axis=0)
    return np.minimum(edge_gaps, np.roll(edge_gaps, 1))


def _measure_minimum(solved_case: SolvedCase, multiplier: Array, suffix: str) -> dict[str, float]:
    """The least (u_h, v - u_h)_1 - (f, v - u_h)_0 over |(f, u_h)_0|, v random in K(h,H) with (3.1).

    u_h is that of the multiplier. The cell means of v - g are 0 for the first v, and >= 0 for the others.
    """
    spaces = solved_case.spaces
    load = solved_case.discrete.load
    H_i = solved_case.spaces.partition.lengths
    u_h = spaces.response(load, multiplier)
    gap = spaces.operator.gap(multiplier, solved_case.discrete.offset)
    excess = np.random.default_rng(0).random((len(H_i), N_DIRECTIONS))
    excess[:, 0] = 0.0
    # w is the response to the mu with B w = H_i (excess - gap): the cell means of u_h + w - g are the excess
    mu: Array = solve(spaces.operator.D, H_i[:, None] * (excess - gap[:, None]), assume_a="pos")
    w = spaces.response(np.zeros((len(u_h), N_DIRECTIONS)), mu)
    values = (spaces.condensed.A @ u_h - load) @ w
    return {f"minimum_in_K{suffix}": float(values.min() / abs(load @ u_h))}


def _measure_forms(spaces: MixedSpaces, rng: np.random.Generator) -> dict[str, float]:
    """A(U, U)/||u||_1^2 of (4.3), the farthest from 1 of random U, and A(U, V)/(|||U||| |||V|||) of (4.2).

    The latter is for ||.||_{-1/2,h} in (4.1), and for U and V of one function and its flux, where it is
    largest. `..._elsewhere` the first has the wrong sign of <lambda, v>, and the second lacks <mu, u>.
    """
    A = spaces.condensed.A
    on_diagonal = []
    for _ in range(N_DIRECTIONS):
        U = (rng.standard_normal(len(spaces.mesh.points)), rng.standard_normal(len(spaces.cells)))
        on_diagonal.append(_form_terms(spaces, U, U) / (U[0] @ (A @ U[0])))
    largest = _largest_form_terms(spaces)
    return {
        "diagonal": _farthest_from_1(np.array(on_diagonal) @ [1, -1, 1]),
        "diagonal_elsewhere": _farthest_from_1(np.array(on_diagonal) @ [1, 1, 1]),
        "continuity": abs(float(largest @ [1, -1, 1])),
        "continuity_elsewhere": abs(float(largest @ [1, -1, 0])),
    }


def _form_terms(spaces: MixedSpaces, U: tuple[Array, Array], V: tuple[Array, Array]) -> Array:
    """The terms (u, v)_1, <lambda, v> and <mu, u>, which A(U, V) has with the signs 1, -1 and 1."""
    boundary = spaces.mesh.boundary
    (u, lambda_) = U
    (v, mu) = V
    u_v = u @ (spaces.condensed.A @ v)
    return np.array([u_v, lambda_ @ (spaces.B @ v[boundary]), mu @ (spaces.B @ u[boundary])])


def _largest_form_terms(spaces: MixedSpaces) -> Array:
    """The terms of A(U, V) for U and V of the norm 1, of one function and its flux, where it is largest."""
    flux = np.full(len(spaces.cells), 1 / math.sqrt(spaces.operator.D.sum()))
    u_h = spaces.response(np.zeros(len(spaces.mesh.points)), flux)
    # With ||u||_1 = ||lambda||_{-1/2,h} = <lambda, u> = 1 the form is the matrix [[1, 1], [-1, 0]] of the
    # coefficients of U and V, and its norm is attained by the first pair of singular vectors
    left_vectors, _, right_vectors = np.linalg.svd([[1.0, 1.0], [-1.0, 0.0]])
    U = (left_vectors[:, 0][0] * u_h, left_vectors[:, 0][1] * flux)
    V = (right_vectors[0][0] * u_h, right_vectors[0][1] * flux)
    return _form_terms(spaces, U, V)


def _farthest_from_1(values: Array) -> float:
    return float(values[np.argmax(np.abs(values - 1))])


def _measure_galerkin(spaces: MixedSpaces) -> dict[str, float]:
    """| ||v||^2 - ||v_h||^2 - ||v - v_h||^2 | / ||v||^2 in H1, v_h the Galerkin approximation of (3.7).

    v = (cosh(x - 1/2) + cosh(y - 1/2)) / sinh(1/2) has the flux 1 on the unit square, and
    ||v||_1^2 = 8 + 4 coth(1/2). `..._elsewhere` v_h is the interpolant of v.
    """
    mesh = spaces.mesh
    A = spaces.condensed.A
    square = 8 + 4 / np.tanh(0.5)  # ||v||_1^2
    galerkin = spaces.response(np.zeros(mesh.n_nodes), np.ones(len(spaces.cells)))
    defects = {}
    for name, v_h in (("galerkin", galerkin), ("galerkin_elsewhere", _unit_flux_solution(mesh.points))):
        # Pythagoras, which holds for the Galerkin approximation alone
        defects[name] = abs(square - float(v_h @ (A @ v_h)) - _squared_unit_flux_error(mesh, v_h)) / square
    return defects


def _unit_flux_solution(points: Array) -> Array:
    return np.asarray(np.cosh(points - 0.5).sum(axis=-1) / np.sinh(0.5))


def _squared_unit_flux_error(mesh: Mesh, v_h: Array) -> float:
    """||v - v_h||_1^2 for that v, by quadrature of the difference itself."""
    hats, weights = symmetric_rule(FLUX_RULE_DEGREE)
    points = np.einsum("qb,tbd->tqd", hats, mesh.points[mesh.triangles])
    nodal = v_h[mesh.triangles]
    value = _unit_flux_solution(points) - nodal @ hats.T
    slope = np.sinh(points - 0.5) / np.sinh(0.5) - np.einsum("ti,tid->td", nodal, gradients(mesh))[:, None]
    return float(mesh.areas @ ((value**2 + np.sum(slope**2, axis=-1)) @ weights))
