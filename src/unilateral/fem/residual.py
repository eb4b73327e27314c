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

The bound with the lumped mass m, 2 (sum_i R_i^2 / m_i)^{1/2}, is too large by up to 1/h; this one is
too large by up to a multiple of log 1/h.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pyamg.amg_core import gauss_seidel
from scipy.sparse.linalg import SuperLU

from unilateral.arrays import Array
from unilateral.fem.hierarchy import Level

COMPUTED, SLOPE = 9, 0.6
"""(2) is used with k up to COMPUTED."""


def growth(k: int) -> float:
    """A bound of M_k."""
    return (1 + SLOPE * COMPUTED) ** (k // COMPUTED) * (1 + SLOPE * (k % COMPUTED))


def dual_norm(levels: Sequence[Level], coarsest: SuperLU, R: Array) -> float:
    """A bound of ||R||, R (n,) on the hats of the last level; `coarsest` factorises level 0."""
    z = downwards(levels, coarsest, R)
    A_z = levels[-1].A @ z
    norm_of_z = math.sqrt(max(float(z @ A_z), 0.0))
    return norm_of_z + without_coarsest(levels, np.subtract(R, A_z, out=A_z))


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
        new = R[level.P.shape[1] :]
        found += math.sqrt(math.sqrt(3) * growth(k) * float(new @ (new / level.roundness)))
        R = level.P.T @ R
    return found
