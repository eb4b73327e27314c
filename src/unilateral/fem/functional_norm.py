"""A guaranteed bound on a functional R on V_h, ||R|| = sup R(v) / ||v||, from nested spaces.

With I_l the interpolation at the nodes of level l, a function v of V_L is I_0 v and, for each level
l = 1, ..., L, its hats at the new nodes times

    w_e = (I_l v)(midpoint of e) - mean of v at the ends of e,      e a halved edge of level l - 1.

Let t be a triangle of level l - 1. In variables in which t is right and isosceles, its reference edge being
the hypotenuse, its descendants are so, too (`geometry.refinement`). If each came by at most 2 j + 1
halvings of areas, halve them on until each came by so many. Their corners and legs are then those of the
criss-cross lattice of 2^j squares on each leg of t, half of them in t; their hypotenuses may be others. But
the cotangent of a right angle is 0, so |v|_1^2 has differences along legs only, and

    |I_0 v|_1^2 <= M_j |v|_1^2      as for v of the lattice, I_0 at the corners of t,               (1)
    sum of w_e^2 over the halved edges of t <= C |I_l v|_{1,t}^2                                    (2)

with C = 1, 1.4473, 2 where t is green, blue, red, the largest eigenvalues of 3 to 6 unknowns, and M_j as in
`interpolation_constant`, computed like those: the largest eigenvalue on two values, the others eliminated.
Used twice, (1) gives M_{i+j} <= M_i M_j. Both are Proposition S18 of the supplement. The map from these
variables, with the ratio r_T <= 1 of its singular values, the same for all descendants of the triangle T of
level 0, changes |v|_1^2 by a factor between r_T and 1 / r_T, and w_e not at all. So, summed over the
triangles t of a level,

    sum over e of w_e^2 rho_e <= k |v|_1^2,      rho_e = sum of k r_T / (C M) over the triangles t at e,

M for what was refined below the children of t, which is 1 if nothing was. Let R_e be R of the level's new
hats. If R vanishes on V_0, Cauchy's inequality on each level gives

    ||R|| <= sum_l (sum_e R_e^2 / rho_e)^{1/2}.                                                     (3)

Any R is (z, .) + R' with z from a V-cycle that smooths on its way down only, and solves on V_0
exactly. So R' vanishes there, and ||R|| <= ||z|| + (3) for R'.

The bound with the lumped mass (`residual_rounding`) is too large by up to 1/h; this one is so by up to a
multiple of log 1/h on uniform meshes, and by more where (1) is used several times, as at a corner where
edges are halved 20 times and more. What rounding leaves of R' on V_0, number by number at the nodes of level
0, and what is not known of R make a functional of its own. It is small enough for the bound with the lumped
mass, and adds nothing to R_e.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from pyamg.amg_core import gauss_seidel_indexed
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array
from unilateral.fem import residual_rounding
from unilateral.fem.hierarchy import Hierarchy
from unilateral.formulas.taylor import EPS

CHILDREN_CONSTANTS = np.array([1, 1, 1.0001, 1.4473, 2.0001])
"""The entry m is an upper bound on C in (2) for a triangle with m children (Proposition S18).

Those with 0 or 1 are not at a halved edge.
"""
INTERPOLATION_CONSTANTS = (2.0001, 2.6667, 3.4959, 4.3659, 5.2453, 6.1271, 7.0094, 7.8919)
"""Upper bounds on M_0, M_1, ..., M_7 in (1) (Proposition S18)."""


def interpolation_constant(halvings: int) -> float:
    """A bound on M for triangles whose areas were halved so often."""
    if halvings == 0:
        return 1.0
    # 2 j + 1 halvings of areas at most have M_j, and M_{i+j} <= M_i M_j: as many factors M_7 as there are
    times, j = divmod(halvings // 2, len(INTERPOLATION_CONSTANTS) - 1)
    last_factor = INTERPOLATION_CONSTANTS[j] if j or not times else 1.0
    return float(INTERPOLATION_CONSTANTS[-1] ** times * last_factor)


def multilevel_dual_norm_bound(hierarchy: Hierarchy, R: Array, rounding: Array | float = 0.0) -> float:
    """An upper bound on ||R|| for a functional R on the hats of the last level, by ||z|| + (3)."""
    # R = (z, .) + R', and ||z||^2 = z . A z
    z = apply_presmoothing_cycle(hierarchy, R)
    A_z = residual_rounding.product_with_rounding(hierarchy.A, hierarchy.row_sums, z)
    norm_of_z = residual_rounding.product_root(z, A_z.values)
    remainder = R - A_z.values
    # what is not known of R, the rounding of A z, in R - A z and in ||z||, and what R' has left on V_0
    rounding = rounding + 2 * A_z.rounding + _bound_coarse_remainder(hierarchy, remainder)
    rounding_norm = residual_rounding.lumped_dual_norm_bound(rounding, hierarchy.nodal_weights)
    return (
        residual_rounding.NORM_ROUNDING_FACTOR * norm_of_z
        + norm_bound_beyond_coarsest(hierarchy, remainder)
        + rounding_norm
    )


def _bound_coarse_remainder(hierarchy: Hierarchy, R: Array) -> Array:
    """Bounds (n,), node by node, on what R has left on V_0 and on the rounding of its restrictions."""
    sizes = np.abs(R)
    R = R.copy()
    rounding = EPS * sizes
    for level in reversed(hierarchy.levels):
        level.restrict(R)
        level.restrict(sizes)
        rounding[level.ends] += EPS * level.max_summands * sizes[level.ends]
    # (3) is for functionals that vanish on V_0: all that is left there counts as rounding
    n = hierarchy.A_0.shape[0]
    rounding[:n] += np.abs(R[:n])
    return rounding


def apply_presmoothing_cycle(hierarchy: Hierarchy, R: Array) -> Array:
    """The z (n,) of a V-cycle for R, with one sweep of Gauss and Seidel on each level on its way down."""
    # down: on each level a sweep from 0, and the residual goes to the level before
    g = R.copy()
    z = np.zeros_like(R)
    n = hierarchy.A_0.shape[0]
    corrections: list[Array] = []
    # the last level has no rows of its own: its sweep takes those of A
    if hierarchy.levels:
        A = hierarchy.A
        nodes = hierarchy.levels[-1].smoothed_nodes
        if nodes is None:
            nodes = np.arange(hierarchy.n, dtype=np.int32)
        gauss_seidel_indexed(A.indptr, A.indices, A.data, z, R, nodes, 0, len(nodes), 1)
        g -= A @ z
        hierarchy.levels[-1].restrict(g)
    for level in reversed(hierarchy.levels[:-1]):
        assert level.rows is not None
        corrections.append(level.sweep_down(level.rows, g)[0])
        level.restrict(g)
    # V_0 exactly; up: nothing is smoothed, so that R - (z, .) vanishes on V_0
    e = np.zeros_like(R)
    e[:n] = hierarchy.coarse_factors.solve(g[:n])
    for level in hierarchy.levels[:-1]:
        level.prolong(e)
        e[slice(level.n) if level.smoothed_nodes is None else level.smoothed_nodes] += corrections.pop()
    if hierarchy.levels:
        hierarchy.levels[-1].prolong(e)
    return z + e


def norm_bound_beyond_coarsest(hierarchy: Hierarchy, R: Array) -> float:
    """The bound (3), for an R (n,) that vanishes on V_0."""
    R = R.copy()
    level_sum = 0.0
    # sum over the levels of (sum_e R_e^2 / rho_e)^{1/2}, from the last level to the first
    for level, rho in zip(reversed(hierarchy.levels), edge_weights(hierarchy), strict=True):
        level_sum += float(dnrm2(R[level.n_coarse : level.n] / np.sqrt(rho)))
        level.restrict(R)
    return residual_rounding.NORM_ROUNDING_FACTOR * level_sum


def edge_weights(hierarchy: Hierarchy) -> Iterator[Array]:
    """The weights rho_e (k,) of the edges that each level has halved, from the last level to the first."""
    # how often, from level 0 on, the area of the smallest descendant of each triangle was halved
    deepest = hierarchy.area_halvings
    M = np.array([interpolation_constant(n) for n in range(int(deepest.max()) + 1)])
    for level in reversed(hierarchy.levels):
        step = level.step
        # how often children of each old triangle are halved on: totals since level 0, less the child's own
        # one; then `deepest` for the level before
        total_halvings = deepest[step.triangles]
        halvings_below = np.zeros(step.n_old_triangles, dtype=np.int16)
        deepest = deepest[: step.n_old_triangles].copy()
        np.maximum.at(halvings_below, step.parent, total_halvings - level.area_halvings)
        np.maximum.at(deepest, step.parent, total_halvings)
        children = np.bincount(step.parent, minlength=step.n_old_triangles)
        # k r_T / (C M) of a triangle t; rho_e is its sum over the one or two triangles at the edge
        rho = (
            hierarchy.form.k
            * hierarchy.roundness[hierarchy.coarse_triangle[: step.n_old_triangles]]
            / (CHILDREN_CONSTANTS[children] * M[halvings_below])
        )
        first, second = step.edge_triangles.T
        yield rho[first] + np.where(second >= 0, rho[second], 0)
