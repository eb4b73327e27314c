"""Sparse linear systems: elimination by nested dissection, with SuperLU, and conjugate gradients.

With the boundary last in the order, one factorisation carries the Schur complement on it in the last block of
its factors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import daxpy
from scipy.sparse.linalg import SuperLU, splu

from unilateral.arrays import Array, Index

try:
    import pymetis
except ModuleNotFoundError:  # there are no wheels for Windows
    pymetis = None  # type: ignore[assignment]

NO_UNKNOWNS = np.empty(0, dtype=np.intp)
MAX_FACTORISED_UNKNOWNS = 10_000
"""A matrix with at most this many unknowns is factorised."""
SUPERLU_OPTIONS = {"SymmetricMode": True}
PROLONGATION_SMOOTHER = ("jacobi", {"omega": 4 / 3, "weighting": "local"})
"""How PyAMG smooths prolongations; its default begins with random numbers."""


@dataclass(frozen=True, eq=False)
class SparseFactors:
    """A matrix (n, n) factorised in the order `order` (n,) of its unknowns."""

    lu: SuperLU
    order: Index

    def solve(self, rhs: Array) -> Array:
        """A^{-1} rhs for rhs (n,) or (n, k)."""
        solution = np.empty_like(rhs, dtype=float)
        solution[self.order] = self.lu.solve(np.asarray(rhs[self.order], dtype=float))
        return solution


def factorise_by_dissection(A: sp.csr_array, boundary: Index = NO_UNKNOWNS) -> SparseFactors:
    """A (n, n) factorised in the order of `elimination_order`."""
    order = elimination_order(A, boundary)
    return SparseFactors(factorise(A, order), order)


def factorise(A: sp.csr_array, order: Index) -> SuperLU:
    """The factors of A (n, n), in its precision, with the unknowns in that order."""
    return splu(
        A[order][:, order].tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options=SUPERLU_OPTIONS
    )


def elimination_order(A: sp.csr_array, boundary: Index = NO_UNKNOWNS) -> Index:
    """The order (n,) of elimination: the interior by nested dissection, then the boundary as it is listed.

    Without METIS the interior has SuperLU's order of minimum degree, for which it is factorised once more.

    Consecutive boundary nodes share an edge, so the elimination tree ends in their chain and SuperLU's
    postordering leaves them last.
    """
    interior = np.delete(np.arange(A.shape[0]), boundary)
    inner = A[interior][:, interior]
    graph = inner.tocoo()
    off_diagonal = graph.row != graph.col
    if not np.any(off_diagonal):
        return np.concatenate([interior, boundary])
    if not pymetis:
        first = splu(inner.tocsc(), permc_spec="MMD_AT_PLUS_A", options=SUPERLU_OPTIONS)
        return np.concatenate([interior[np.argsort(first.perm_c)], boundary])
    # `starts` needs the entries sorted by row, as those of CSR are
    rows = graph.row[off_diagonal]
    neighbours = graph.col[off_diagonal]
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(interior)))])
    dissection, _ = pymetis.nested_dissection(pymetis.CSRAdjacency(starts, neighbours))
    return np.concatenate([interior[np.asarray(dissection)], boundary])


def schur_factor(lu: SuperLU, size: int) -> Array:
    """R (size, size) upper triangular with R^T R the Schur complement on the last `size` unknowns.

    A = L U with U = diag(pivots) L^T, so R is the last block of U with its rows over the pivots' roots.
    """
    first = lu.shape[0] - size
    last = np.arange(first, lu.shape[0])
    if not (np.array_equal(lu.perm_c[first:], last) and np.array_equal(lu.perm_r, lu.perm_c)):
        raise RuntimeError("SuperLU moved the boundary unknowns away from the end of the elimination")
    block = lu.U[:, first:][first:].toarray()
    return block / np.sqrt(np.diag(block))[:, None]


def half_solve(A: sp.csr_array, F: sp.csc_array, order: Index) -> sp.csr_array:
    """X (n, k) with X^T X = F^T A^{-1} F, for a symmetric positive definite A (n, n) and a sparse F (n, k).

    A factorisation of A bordered by F, its unknowns last, leaves L^{-1} F beside the factors of A = L U,
    U = diag(pivots) L^T: it fills in only along the separators, where solutions are dense. Rows of X are in
    the `order` of elimination.
    """
    n, k = F.shape
    # -I in the corner keeps its pivots away from 0: what is left there is -(I + F^T A^{-1} F)
    bordered = sp.block_array([[A, F], [F.T, -sp.eye_array(k)]], format="csr")
    lu = factorise(bordered, np.append(order, np.arange(n, n + k)))
    if not np.array_equal(lu.perm_r, lu.perm_c):
        raise RuntimeError("SuperLU exchanged rows of a symmetric matrix")
    # X = diag(pivots)^{-1/2} L^{-1} F, where L^{-1} F is the block of U beside the factors of A
    A_rows = lu.perm_c[:n]
    pivots = lu.U.diagonal()
    return sp.csr_array(lu.U[:, lu.perm_c[n:]].tocsr()[A_rows] / np.sqrt(pivots[A_rows])[:, None])


class OrderedMatrix(NamedTuple):
    """A symmetric positive definite matrix (n, n), and the order (n,) in which it is eliminated."""

    A: sp.csr_array
    order: Index

    def inverse_products(self, F: sp.csc_array) -> Array:
        """The matrix F^T A^{-1} F for a sparse F; shape (k, k)."""
        half = half_solve(self.A, F, self.order)
        return (half.T @ half).toarray()


class ConjugateGradients:
    """The change x (n,) of an iterate for A v = b, with a positive definite A, and its residual r (n,).

    `apply_matrix` takes v to A v, and `precondition` r to z; both are symmetric, and the second one may be 0
    for some r: then v has its minimum among the functions that it reaches. `rz` is r . z. The first residual
    is overwritten.
    """

    def __init__(
        self, apply_matrix: Callable[[Array], Array], r: Array, precondition: Callable[[Array], Array]
    ) -> None:
        self.apply_matrix = apply_matrix
        self.precondition = precondition
        self.x = np.zeros_like(r)
        self.r = r
        self.p = precondition(r)
        self.rz = float(r @ self.p)

    def step(self) -> float:
        """Makes a step. Returns the decrease of v . A v - 2 b . v, which has its minimum where A v = b."""
        if not self.rz > 0:
            return 0.0
        # x + alpha p with alpha = r . z / p . A p; the next p is z + (r . z / its value before) p
        A_p = self.apply_matrix(self.p)
        old = self.rz
        curvature = float(self.p @ A_p)
        if not curvature > 0:  # rounding hides it, as on domains far smaller than 1
            self.rz = 0.0
            return 0.0
        alpha = old / curvature
        daxpy(self.p, self.x, a=alpha)
        daxpy(A_p, self.r, a=-alpha)
        del A_p  # its memory is needed for z
        z = self.precondition(self.r)
        self.rz = float(self.r @ z)
        self.p *= self.rz / old
        self.p += z
        return alpha * old


def approximate_inverse(A: sp.csr_array) -> Callable[[Array], Array]:
    """A^{-1} (n, n) itself where that is cheap, else a symmetric cycle of algebraic multigrid."""
    if A.shape[0] <= MAX_FACTORISED_UNKNOWNS:
        return factorise_by_dissection(A).solve if A.shape[0] else np.copy
    import pyamg  # whose import takes longer than small systems

    levels = pyamg.smoothed_aggregation_solver(sp.csr_matrix(A), smooth=PROLONGATION_SMOOTHER)
    return levels.aspreconditioner().matvec  # type: ignore[no-any-return]
