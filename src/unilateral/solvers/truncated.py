"""V-cycles for functions that vanish at some nodes of the finest of nested levels.

T puts 0 at these nodes, and keeps the values at others. The matrices of the levels below are those of
the truncated functions T P v, T P P v and so on, and none of their nodes is left out. So a coarse hat
that is cut by many small contact zones has the energy that the cuts cost. This is the truncation of R.
Kornhuber (Numer. Math. 69, 1994, 167-184), on the finest level only. With D = A - T A T, and P^T A P
the matrix of the level below,

    S = P^T T A T P = P^T A P - P^T D P

differs from that matrix only in the rows of hats that reach the truncated nodes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from pyamg.amg_core import gauss_seidel
from scipy.sparse.linalg import splu

from unilateral.arrays import Array, Index
from unilateral.fem.hierarchy import Level

CUT_AWAY = 1e-10
"""Of a hat's energy: where less is left, all is rounding, and the hat is 0."""


class Truncated:
    """The levels below the last one, of at least two, with T zero at its nodes `fixed`."""

    def __init__(self, levels: Sequence[Level], fixed: Index) -> None:
        self.levels, self.fixed = levels, fixed
        self.matrices: list[sp.csr_array] = []
        D = _rows_and_columns(levels[-1].A, fixed)
        for finer, level in zip(levels[:0:-1], levels[-2::-1], strict=True):
            D = ((D @ finer.P).T.tocsr() @ finer.P).tocsr()
            self.matrices.insert(0, _minus(level.A, D))
        self.coarsest = splu(self.matrices[0].tocsc())

    def correct(self, z: Array, r: Array) -> None:
        """z (n,) += T P C P^T T (r - A z), C one V-cycle."""
        finest = self.levels[-1]
        d = finest.A @ z
        np.subtract(r, d, out=d)
        d[self.fixed] = 0
        d = finest.P @ self._cycle(len(self.matrices) - 1, finest.P.T @ d)
        d[self.fixed] = 0
        z += d

    def _cycle(self, k: int, r: Array) -> Array:
        """From 0 one sweep of Gauss and Seidel forward, the levels below k, one sweep backward."""
        if k == 0:
            return np.asarray(self.coarsest.solve(r))
        S, P, x = self.matrices[k], self.levels[k].P, np.zeros_like(r)
        gauss_seidel(S.indptr, S.indices, S.data, x, r, 0, len(r), 1)
        d = S @ x
        np.subtract(r, d, out=d)
        x += P @ self._cycle(k - 1, P.T @ d)
        gauss_seidel(S.indptr, S.indices, S.data, x, r, len(r) - 1, -1, -1)
        return x


def _rows_and_columns(A: sp.csr_array, nodes: Index) -> sp.csr_array:
    """The symmetric A's entries whose row or column is one of the nodes."""
    rows = A[nodes].tocoo()
    i, j = nodes[rows.row], rows.col
    chosen = np.zeros(A.shape[0], dtype=bool)
    chosen[nodes] = True
    other = ~chosen[j]
    entries = np.concatenate([rows.data, rows.data[other]])
    places = (np.concatenate([i, j[other]]), np.concatenate([j, i[other]]))
    return sp.csr_array((entries, places), shape=A.shape)


def _minus(A: sp.csr_array, D: sp.csr_array) -> sp.csr_array:
    """A - D in A's pattern, which contains D's; hats that are cut away keep their diagonal entry."""
    rows = np.flatnonzero(np.diff(D.indptr))
    if not len(rows):
        return A
    count = A.indptr[rows + 1] - A.indptr[rows]
    row = np.repeat(rows, count)
    place = np.arange(len(row)) + np.repeat(A.indptr[rows + 1] - np.cumsum(count), count)
    data = A.data.copy()
    data[place] -= np.asarray(sp.csr_matrix(D)[row, A.indices[place]]).ravel()
    cut_away = (row == A.indices[place]) & (data[place] < CUT_AWAY * A.data[place])
    data[place[cut_away]] = A.data[place[cut_away]]
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)
