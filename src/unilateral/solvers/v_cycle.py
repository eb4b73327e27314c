"""V-cycles for functions that vanish at some nodes of the finest of nested levels.

T puts 0 at these nodes, and keeps the values at others. The matrices of the levels below are those of
the truncated functions T P v, T P P v and so on, and none of their nodes is left out. So a coarse hat
that is cut by many small contact zones has the energy that the cuts cost. This is the truncation of R.
Kornhuber (Numer. Math. 69, 1994, 167-184), on the finest level only. With D = A - T A T, and P^T A P
the matrix of the level below,

    S = P^T T A T P = P^T A P - P^T D P

differs from that matrix only in the rows of hats that reach the truncated nodes. D is kept on these nodes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from pyamg.amg_core import gauss_seidel_indexed
from scipy.sparse.linalg import SuperLU, splu

from unilateral.arrays import Array, Index, Int32, Mask
from unilateral.fem.hierarchy import FinerSpace, Hierarchy

MIN_ENERGY_SHARE = 1e-10
"""If less than this fraction of a hat's energy is left, all of it is rounding, and the hat counts as 0."""


class NodalMatrix(NamedTuple):
    """A symmetric matrix that is 0 but for the rows and columns of the `nodes` (k,), increasing."""

    nodes: Index
    values: sp.csr_array


class SymmetricCycle:
    """One symmetric V-cycle on all levels, for functions that are 0 at the truncated and the clamped nodes.

    Its eigenvalues lie in (0, 1]. The hats that the last level has changed are smoothed there.
    """

    def __init__(self, hierarchy: Hierarchy, is_truncated: Mask) -> None:
        self.A = hierarchy.A
        self.coarse_correction = TruncatedCycle(hierarchy, np.flatnonzero(is_truncated))
        is_smoothed = np.zeros(hierarchy.n, dtype=bool)
        smoothed = hierarchy.levels[-1].smoothed_nodes
        is_smoothed[slice(None) if smoothed is None else smoothed] = True
        self.nodes = np.flatnonzero(is_smoothed & ~is_truncated & ~hierarchy.clamped_nodes).astype(np.int32)

    def apply(self, r: Array) -> Array:
        """The correction z (n,) for r (n,), which is 0 at the nodes that are left out."""
        z = np.zeros_like(r)
        last = len(self.nodes)
        self._sweep(z, r, 0, last, 1)
        self.coarse_correction.correct(self.A, z, r)
        self._sweep(z, r, last - 1, -1, -1)
        return z

    def _sweep(self, z: Array, r: Array, start: int, stop: int, step: int) -> None:
        """One sweep of Gauss and Seidel for A z = r over the smoothed nodes."""
        A = self.A
        gauss_seidel_indexed(A.indptr, A.indices, A.data, z, r, self.nodes, start, stop, step)


class TruncatedCycle:
    """The levels below the last one of a hierarchy that has at least two; T is 0 at the `truncated_nodes`."""

    def __init__(self, hierarchy: Hierarchy, truncated_nodes: Index) -> None:
        self.last_level = hierarchy.levels[-1]
        self.lower_levels = hierarchy.levels[:-1]
        self.truncated_nodes = truncated_nodes
        self.truncated_coarse_nodes = truncated_nodes[truncated_nodes < self.last_level.n_coarse]
        self.truncated_new_nodes = truncated_nodes[truncated_nodes >= self.last_level.n_coarse]
        # from fine to coarse: S = P^T A P - P^T D P, and the next D is P^T D P
        D = _galerkin_product(self.last_level, _extract_node_entries(hierarchy.A, truncated_nodes))
        self.matrices: list[sp.csr_array] = []
        for level in reversed(self.lower_levels):
            self.matrices.insert(0, _subtract_from_level(level, D))
            D = _galerkin_product(level, D)
        self.coarse_factors = _factorise_coarsest(
            _subtract_in_pattern(hierarchy.A_0, D.nodes, D), hierarchy.A_0
        )

    def correct(self, A: sp.csr_array, z: Array, r: Array) -> None:
        """Adds T P C P^T T (r - A z) to z (n,), where C is one V-cycle and A the matrix of the last level."""
        # T (r - A z), restricted; the correction is prolonged and truncated
        d = A @ z
        np.subtract(r, d, out=d)
        d[self.truncated_nodes] = 0
        self.last_level.restrict(d)
        e = self._apply_cycle(d[: self.last_level.n_coarse])
        new = self.last_level.P @ e[self.last_level.ends]
        e[self.truncated_coarse_nodes] = 0
        new[self.truncated_new_nodes - self.last_level.n_coarse] = 0
        z[: self.last_level.n_coarse] += e
        z[self.last_level.n_coarse :] += new

    def _apply_cycle(self, r: Array) -> Array:
        """The correction e (n,) of one V-cycle for r (n,), which is overwritten."""
        # one forward sweep of each level on the way down, one backward sweep on the way up
        sweeps = []
        for level, S in zip(reversed(self.lower_levels), reversed(self.matrices), strict=True):
            sweeps.append(level.sweep_down(S, r))
            level.restrict(r)
        e = np.zeros_like(r)
        n = self.coarse_factors.shape[0]
        e[:n] = self.coarse_factors.solve(r[:n])
        for level, S in zip(self.lower_levels, self.matrices, strict=True):
            level.prolong(e)
            level.sweep_up(S, e, *sweeps.pop())
        return e


def _factorise_coarsest(S: sp.csr_array, A_0: sp.csr_array) -> SuperLU:
    """Factors of S or, if S is singular, of S + MIN_ENERGY_SHARE diag(A_0)."""
    try:
        return splu(S.tocsc())
    except RuntimeError:
        # hats that are cut may depend on each other, because few nodes are left. The added term makes the
        # correction of such functions, which are 0, small in place of arbitrary
        return splu((S + sp.diags_array(MIN_ENERGY_SHARE * A_0.diagonal())).tocsc())


def _extract_node_entries(A: sp.csr_array, nodes: Index) -> NodalMatrix:
    """D = A - T A T: the symmetric A's entries whose row or column is one of the nodes, at which T is 0."""
    rows = A[nodes].tocoo()
    i = nodes[rows.row]
    j = rows.col
    is_chosen = np.zeros(A.shape[0], dtype=bool)
    is_chosen[nodes] = True
    # rows of the nodes, and by symmetry their columns; entries between two of the nodes are in both
    outside = ~is_chosen[j]
    all_nodes, place = np.unique(np.concatenate([i, j]), return_inverse=True)
    place_i, place_j = np.split(place, [len(i)])
    entries = np.concatenate([rows.data, rows.data[outside]])
    places = np.concatenate([place_i, place_j[outside]]), np.concatenate([place_j, place_i[outside]])
    return NodalMatrix(all_nodes, sp.csr_array((entries, places), shape=(len(all_nodes), len(all_nodes))))


def _galerkin_product(level: FinerSpace, D: NodalMatrix) -> NodalMatrix:
    """The matrix P^T D P on the level before."""
    # P has a 1 for each old node of D, and the two halves for each new one
    new = D.nodes >= level.n_coarse
    rows = level.P[D.nodes[new] - level.n_coarse]
    reached = np.concatenate([D.nodes[~new], level.ends[rows.indices]])
    nodes, coarse = np.unique(reached, return_inverse=True)
    k = np.count_nonzero(~new)
    fine = np.concatenate([np.flatnonzero(~new), np.repeat(np.flatnonzero(new), 2)])
    entries = np.concatenate([np.ones(k), rows.data])
    P = sp.csr_array((entries, (fine, coarse)), shape=(len(D.nodes), len(nodes)))
    return NodalMatrix(nodes, ((D.values @ P).T.tocsr() @ P).tocsr())


def _subtract_from_level(level: FinerSpace, D: NodalMatrix) -> sp.csr_array:
    """The level's rows minus D, in the pattern of these rows, which contains the pattern of D."""
    # a level that was refined in a part only has the rows of its smoothed nodes, in an order of its own
    assert level.rows is not None
    if level.smoothed_nodes is None:
        return _subtract_in_pattern(level.rows, D.nodes, D)
    place = np.full(level.n, -1, dtype=np.int32)
    place[level.smoothed_nodes] = np.arange(len(level.smoothed_nodes), dtype=np.int32)
    return _subtract_in_pattern(level.rows, place[D.nodes], D, level.columns)


def _subtract_in_pattern(
    A: sp.csr_array, rows: Index, D: NodalMatrix, columns: Int32 | None = None
) -> sp.csr_array:
    """A - D, where `rows` are the rows of A that belong to D's nodes, -1 for nodes without one.

    Hats that are cut away keep their diagonal entry. In `A.indices` row r's diagonal entry has the number r;
    `columns` (m,) gives these numbers' nodes in the numbering of D, by default the same.
    """
    D_rows = np.flatnonzero(rows >= 0)
    if not len(D_rows):
        return A
    entries, number = _entries_of_rows(A, rows[D_rows])
    D_row = D_rows[number]
    # the entries of A whose columns are nodes of D, and where D has these columns
    node = A.indices[entries] if columns is None else columns[A.indices[entries]]
    D_column = np.minimum(np.searchsorted(D.nodes, node), len(D.nodes) - 1)
    in_D = D.nodes[D_column] == node
    D_entries = np.zeros(len(entries))
    D_entries[in_D] = np.asarray(sp.csr_matrix(D.values)[D_row[in_D], D_column[in_D]]).ravel()
    data = A.data.copy()
    data[entries] -= D_entries
    # where nothing but rounding is left of a hat its diagonal stays as it was: no sweep divides by rounding
    is_diagonal = rows[D_row] == A.indices[entries]
    cut_away = entries[is_diagonal & (data[entries] < MIN_ENERGY_SHARE * A.data[entries])]
    data[cut_away] = A.data[cut_away]
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)


def _entries_of_rows(A: sp.csr_array, rows: Index) -> tuple[Index, Index]:
    """The places in `A.data` of all entries of some rows, row after row, and the number in `rows` of each."""
    count = A.indptr[rows + 1] - A.indptr[rows]
    entries = np.arange(count.sum()) + np.repeat(A.indptr[rows + 1] - np.cumsum(count), count)
    return entries, np.repeat(np.arange(len(rows)), count)
