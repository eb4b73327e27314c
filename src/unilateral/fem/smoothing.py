"""Sweeps of Gauss and Seidel on one level of a hierarchy, over the nodes whose hats it changed."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from pyamg.amg_core import gauss_seidel

from unilateral.arrays import Array
from unilateral.fem.hierarchy import FinerSpace


def downward(level: FinerSpace, S: sp.csr_array, r: Array) -> tuple[Array, Array]:
    """x (s,), one sweep of Gauss and Seidel from 0 for r (n,), and what is left then; S x is taken from r."""
    if level.smoothed is None:
        x, of = np.zeros(level.n), r[: level.n]
        gauss_seidel(S.indptr, S.indices, S.data, x, of, 0, level.n, 1)
        of -= S @ x
        return x, of.copy()
    assert level.columns is not None
    x, k = np.zeros(S.shape[1]), S.shape[0]
    gauss_seidel(S.indptr, S.indices, S.data, x, r[level.smoothed], 0, k, 1)
    r[level.columns] -= S.T @ x[:k]
    return x[:k], r[level.smoothed]


def upward(level: FinerSpace, S: sp.csr_array, e: Array, x: Array, left: Array) -> None:
    """Add x and a backward sweep for what is left (s,) to e (n,), which so far comes from coarser levels."""
    if level.smoothed is None:
        below, y = e[: level.n], np.zeros(level.n)
        left -= S @ below
        gauss_seidel(S.indptr, S.indices, S.data, y, left, level.n - 1, -1, -1)
        below += x
        below += y
        return
    y, k = np.zeros(S.shape[1]), S.shape[0]
    left -= S @ e[level.columns]
    gauss_seidel(S.indptr, S.indices, S.data, y, left, k - 1, -1, -1)
    e[level.smoothed] += x + y[:k]
