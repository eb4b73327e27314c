"""A function v = u - w of V_h that obeys the discrete constraints, for an algebraic bound.

For u and lambda >= 0, w is the sum of hats at nodes inside the cells with which B v >= d and
lambda . (B v - d) = 0. u and w are rounded numbers, so v is not known exactly. The bound
includes by how much it may differ.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index
from unilateral.fem.rounded import SLACK, Rounded, constrained, loaded, residual, root
from unilateral.formulas.taylor import EPS


def feasible(
    A: sp.csr_array,
    mass: Array,
    load: Array,
    B: sp.csr_array,
    d: Array,
    inside: Index,
    u: Array,
    lambda_H: Array,
) -> tuple[Rounded, float]:
    """The residual load + B^T lambda_H - A v (n,), and ||w||_1, with the rounding of v, w and the residual.

    The problem gives A (n, n) with the sums `mass` (n,) of its rows, B (m, n), d (m,), and a node `inside`
    (m,) each cell. u (n,) and lambda_H (m,) >= 0 are arbitrary.
    """
    gap, weights = constrained(B, u, d), B[:, inside].diagonal()
    w = np.where(lambda_H > 0, gap.values, np.minimum(gap.values, 0)) / weights
    v = u.copy()
    v[inside] -= w
    moved = (lambda_H > 0) | (gap.values < gap.doubt)
    doubt = np.where(moved, gap.doubt / weights + EPS * (np.abs(w) + np.abs(v[inside])), 0.0)
    own, size = abs(A[inside][:, inside]), np.abs(w)  # nothing cancels: a norm from above
    norm = root(size, own @ size) + 2 * root(doubt, own @ doubt)
    return residual(A, mass, v, loaded(load, B, lambda_H)), SLACK * norm
