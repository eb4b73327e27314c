"""A guaranteed bound of a functional R on V_h, ||R|| = sup R(v) / ||v||_1, from nested spaces.

With I_l the interpolation at the nodes of level l, a function v of V_L is I_0 v and, for each level
l = 1, ..., L, its hats at the new nodes times

    w_e = (I_l v)(midpoint of e) - mean of v at the ends of e,      e an edge of level l - 1.

On an equilateral triangle t of level l - 1 with the edges 1, 2, 3

    w_1^2 + w_2^2 + w_3^2 <= 3^{1/2} |I_l v|_{1,t}^2,                                               (1)

attained for w_1 = w_2 = w_3 on a v with v = 0 at the nodes of t. On one that is refined k times

    |I_0 v|_1^2 <= M_k |v|_1^2,      M_k <= 1 + 0.6 k for k <= 9,                                   (2)

for by symmetry the least |v|_1^2 for values at its nodes is |I_0 v|_1^2 over a number M_k; that is how
much the resistance between two of the nodes grows, in the network whose conductances are the entries
of the matrix. It is computed. Used twice, (2) gives M_{j+k} <= M_j M_k. The map from an equilateral
triangle onto T, with the ratio r_T <= 1 of its singular values, changes |v|_1^2 by a factor between
r_T and 1 / r_T, and w_e not at all. So for each T of level 0, with all triangles t and edges e in it,

    r_T sum_t (w_1^2 + w_2^2 + w_3^2) <= 3^{1/2} M_{L-l} |v|_{1,T}^2.

Let R_e be R of the level's new hats, and r_e the sum of r_T over the one or two triangles at e. If R
vanishes on V_0, Cauchy's inequality on each level gives

    ||R|| <= sum_l (3^{1/2} M_{L-l} sum_e R_e^2 / r_e)^{1/2}.                                       (3)

Any R is (z, .)_1 + R' with z from a V-cycle that smooths on its way down only, and solves on V_0
exactly. So R' vanishes there, and ||R|| <= ||z||_1 + (3) for R'.

The bound with the lumped mass (`rounded`) is too large by up to 1/h; this one is too large by up to a
multiple of log 1/h. What rounding leaves of R' on V_0, at a node of level 0 each, and what R is not known
by, is a functional of its own, small enough for that one: it adds nothing to R_e.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pyamg.amg_core import gauss_seidel
from scipy.linalg.blas import dnrm2
from scipy.sparse.linalg import SuperLU

from unilateral.arrays import Array
from unilateral.fem import rounded
from unilateral.fem.hierarchy import Level
from unilateral.formulas.taylor import EPS

COMPUTED, SLOPE = 9, 0.6
"""(2) is used with k up to COMPUTED."""


def growth(k: int) -> float:
    """A bound of M_k."""
    return (1 + SLOPE * COMPUTED) ** (k // COMPUTED) * (1 + SLOPE * (k % COMPUTED))


def dual_norm(levels: Sequence[Level], coarsest: SuperLU, R: Array, doubt: Array | float = 0.0) -> float:
    """A bound of ||R||, R (n,) on the hats of the last level, where it is known up to the `doubt` (n,).

    `coarsest` factorises level 0.
    """
    finest, z = levels[-1], downwards(levels, coarsest, R)
    A_z = rounded.product(finest.A, finest.mass, z)
    norm_of_z, left = rounded.root(z, A_z.values), R - A_z.values
    doubt = doubt + 2 * A_z.doubt + _of_restriction(levels, left)  # of R - A z, and of ||z||
    return rounded.SLACK * norm_of_z + without_coarsest(levels, left) + rounded.dual_norm(doubt, finest.mass)


def _of_restriction(levels: Sequence[Level], R: Array) -> Array:
    """(n,) what R has on V_0, and the rounding of its numbers on all levels, at the nodes of these."""
    sizes = np.abs(R)
    found = EPS * sizes
    for level in reversed(levels[1:]):
        R, sizes = level.P.T @ R, level.P.T @ sizes
        found[: len(R)] += EPS * rounded.terms(level.A) * sizes
    found[: len(R)] += np.abs(R)
    return np.asarray(found)


def downwards(levels: Sequence[Level], coarsest: SuperLU, R: Array) -> Array:
    """z (n,) of the V-cycle, with one sweep of Gauss and Seidel on each level."""
    if len(levels) == 1:
        return np.asarray(coarsest.solve(R))
    level, z = levels[-1], np.zeros_like(R)
    gauss_seidel(level.A.indptr, level.A.indices, level.A.data, z, R, 0, len(R), 1)
    d = level.A @ z
    np.subtract(R, d, out=d)
    z += level.P @ downwards(levels[:-1], coarsest, level.P.T @ d)
    return z


def without_coarsest(levels: Sequence[Level], R: Array) -> float:
    """(3), for an R that vanishes on V_0."""
    found = 0.0
    for k, level in enumerate(reversed(levels[1:])):
        new = R[level.P.shape[1] :] / np.sqrt(level.roundness)
        found += math.sqrt(math.sqrt(3) * growth(k)) * float(dnrm2(new))
        R = level.P.T @ R
    return rounded.SLACK * found
