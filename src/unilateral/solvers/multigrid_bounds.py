"""What is guaranteed on nested levels: a bound on algebraic errors, a lower bound on the norm of lambda_H.

The first is one for any u and lambda_H >= 0. Let w be the sum of hats at nodes inside the cells with which
v = u - w fulfils B v >= d and lambda . (B v - d) = 0. Two pairs that fulfil both have
(B v - B u_h) . (lambda - lambda_H) <= 0. So with R = A v - load - B^T lambda, ||.|| its dual norm on V_h, and
A (v - u_h) - R = B^T (lambda - lambda_H),

    ||v - u_h||_1^2 + ||lambda - lambda_H||_{-1/2,h}^2
        = ||R||^2 + 2 (B v - B u_h) . (lambda - lambda_H) <= ||R||^2,

so that ||u - u_h||_1 and ||lambda - lambda_H||_{-1/2,h} are at most ||R|| + ||w||_1. ||R|| is bounded as in
`fem.functional_norm`. u and w are rounded numbers, so v is not known exactly; the bound includes by how much
it may differ.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unilateral.arrays import Array
from unilateral.fem import residual_rounding
from unilateral.fem.functional_norm import apply_presmoothing_cycle, multilevel_dual_norm_bound
from unilateral.fem.hierarchy import Hierarchy
from unilateral.fem.residual_rounding import NORM_ROUNDING_FACTOR, Rounded, product_root
from unilateral.formulas.taylor import EPS
from unilateral.solvers.kernel_cg import Grid

MAX_NORM_CYCLES = 6
"""A lower bound on the norm of lambda_H takes at most so many V-cycles on a level."""
MIN_NORM_GAIN = 0.01
"""Cycles end before one that would add no more than this fraction to the square of the norm; so do levels."""


def multilevel_algebraic_bound(grid: Grid, u: Array, lambda_H: Array) -> float:
    """A guaranteed bound on both errors, for any u (n,) and lambda_H (m,) >= 0."""
    R, norm = shift_to_feasible(grid, u, lambda_H)
    return multilevel_dual_norm_bound(grid.hierarchy, *R) + norm


def shift_to_feasible(grid: Grid, u: Array, lambda_H: Array) -> tuple[Rounded, float]:
    """The residual load + B^T lambda_H - A v (n,), and ||w||_1, with the rounding of v and w."""
    A = grid.hierarchy.A
    B = grid.cells.B
    inside = grid.cells.inner_node
    # w_i is the gap over the integral of the hat at the node inside: B v = d where lambda > 0, B v >= d else
    gap = residual_rounding.gap_with_rounding(B, u, grid.d)
    weights = B[:, inside].diagonal()
    w = np.where(lambda_H > 0, gap.values, np.minimum(gap.values, 0)) / weights
    v = u.copy()
    v[inside] -= w
    # how far v may be from the v meant: the rounding of the gap, of the quotient and of the difference.
    # It counts twice, once for w and once for v
    changed = (lambda_H > 0) | (gap.values < gap.rounding)
    w_rounding = np.where(changed, gap.rounding / weights + EPS * (np.abs(w) + np.abs(v[inside])), 0.0)
    A_inside = abs(A[inside][:, inside])
    w_size = np.abs(w)  # nothing cancels: a norm from above
    norm = product_root(w_size, A_inside @ w_size) + 2 * product_root(w_rounding, A_inside @ w_rounding)
    load = residual_rounding.load_with_rounding(grid.load, B, lambda_H)
    R = residual_rounding.residual_with_rounding(A, grid.hierarchy.row_sums, v, load)
    return R, NORM_ROUNDING_FACTOR * norm


def multiplier_norm_lower_bound(grids: Sequence[Grid], lambda_H: Array) -> float:
    """A lower bound on ||lambda_H||_{-1/2,h} for lambda_H (m,) >= 0: <lambda_H, v> / ||v||_1 for one v."""
    # the functional <lambda_H, .> on the hats of each level, coarse levels first
    functionals = [grids[-1].cells.B.T @ lambda_H]
    for grid in grids[:0:-1]:
        R = functionals[0].copy()
        grid.hierarchy.levels[-1].restrict(R)
        functionals.insert(0, R[: grid.hierarchy.levels[-1].n_coarse])
    # from coarse to fine; the last grid is the first that adds so little to the square that all others, if
    # each added as much, would still add little
    norm = 0.0
    for remaining, grid, R in zip(range(len(grids))[::-1], grids, functionals, strict=True):
        previous_norm = norm
        norm = max(norm, functional_norm_lower_bound(grid.hierarchy, R))
        if remaining * (norm**2 - previous_norm**2) < MIN_NORM_GAIN * norm**2:
            break
    return norm


def functional_norm_lower_bound(hierarchy: Hierarchy, R: Array) -> float:
    """A lower bound on ||R||, R (n,) on the hats of the last level: R . v / ||v||_1 for one v."""
    unit = float(np.abs(R).max(initial=0.0))
    v = _solve_by_cycles(hierarchy, R / unit) if unit > 0 else np.zeros_like(R)
    # ||v|| <= (v . A v)^{1/2} as computed, and the dual norm of the rounding of A v
    A_v = residual_rounding.product_with_rounding(hierarchy.A, hierarchy.row_sums, v)
    norm = NORM_ROUNDING_FACTOR * product_root(v, A_v.values) + residual_rounding.lumped_dual_norm_bound(
        A_v.rounding, hierarchy.nodal_weights
    )
    return max(float(R @ v), 0.0) / norm if norm > 0 else 0.0


def _solve_by_cycles(hierarchy: Hierarchy, R: Array) -> Array:
    """v (n,) with A v nearly R (n,), by a few V-cycles."""
    # each is for the residual that is left, and its result is made conjugate to those before
    residual = R
    v = np.zeros_like(R)
    directions = list[tuple[Array, Array]]()
    for _ in range(MAX_NORM_CYCLES):
        p = apply_presmoothing_cycle(hierarchy, residual)
        A_p = residual_rounding.product_with_rounding(hierarchy.A, hierarchy.row_sums, p).values
        for q, A_q in directions:
            coefficient = (p @ A_q) / (q @ A_q)
            p = p - coefficient * q
            A_p = A_p - coefficient * A_q
        # the step gain / square along p adds gain^2 / square to R . v, which is ||v||^2
        gain = float(p @ residual)
        p_square = float(p @ A_p)
        if not (p_square > 0 and gain**2 > MIN_NORM_GAIN * p_square * float(v @ R)):
            break
        directions.append((p, A_p))
        v = v + gain / p_square * p
        residual = residual - gain / p_square * A_p
    return v
