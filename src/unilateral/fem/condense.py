"""Partial elimination of the interior unknowns (the paper, section 5): A c = g becomes A_3 c'' = g''.

The interior is ordered by nested dissection and the boundary comes last, so that one sparse LU
factorisation carries the Schur complement A_3 in the last block of its factors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pymetis
import scipy.sparse as sp
from scipy.linalg import cho_solve, solve_triangular
from scipy.sparse.linalg import LinearOperator, SuperLU, eigsh, splu

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.fem.p1 import boundary_mass, stiffness_and_mass
from unilateral.geometry.mesh import Mesh

NONE = np.empty(0, dtype=np.intp)
CONSTANTS = 1e-8
"""How accurately constants must be solved for; what is guaranteed is so up to this rounding of A_3."""


@dataclass(frozen=True, eq=False)
class Condensed:
    """The matrix A (n, n) of (., .)_1 on V_h, factorised, and its condensation to the boundary.

    `A_3` (nb, nb) is the Schur complement on `mesh.boundary`; `cholesky` (nb, nb) is its upper
    triangular factor R with A_3 = R^T R; `lu` factorises A in the order `order` (n,) of the nodes.
    """

    mesh: Mesh
    A: sp.csr_array
    A_3: Array
    cholesky: Array
    lu: SuperLU
    order: Index

    def solve(self, rhs: Array) -> Array:
        """A^{-1} rhs on all nodes, for rhs (n,) or (n, k)."""
        solution = np.empty_like(rhs, dtype=float)
        solution[self.order] = self.lu.solve(np.asarray(rhs[self.order], dtype=float))
        return solution

    def solve_boundary(self, rhs: Array) -> Array:
        """A_3^{-1} rhs for rhs (nb,) or (nb, k)."""
        return cho_solve((self.cholesky, False), rhs)

    @cached_property
    def sigma_1(self) -> float:
        """The smallest sigma with (v, w)_1 = sigma <v, w> for all w in V_h, above Steklov's by O(h^2)."""
        mass, size = boundary_mass(self.mesh), len(self.mesh.boundary)

        def similar(v: Array) -> Array:
            R = self.cholesky
            return solve_triangular(R, mass @ solve_triangular(R, v), trans="T")

        operator = LinearOperator((size, size), matvec=similar, dtype=float)
        return float(1 / eigsh(operator, k=1, v0=np.ones(size), return_eigenvectors=False)[0])


def condense(mesh: Mesh) -> Condensed:
    """Factorise A on the mesh and condense it to the boundary nodes.

    Raises InputError where the domain is so small that rounding loses the constants.
    """
    stiffness, mass = stiffness_and_mass(mesh)
    A = stiffness + mass
    order = elimination_order(A, mesh.boundary)
    lu = factorise(A, order)
    check_constants(mesh, lu.solve(mass.sum(axis=1)[order]))
    cholesky = last_block(lu, len(mesh.boundary))
    return Condensed(mesh, A, cholesky.T @ cholesky, cholesky, lu, order)


def dissected(condensed: Condensed) -> Condensed:
    """The same with A factorised by nested dissection of all nodes, as one would who does not eliminate."""
    order = elimination_order(condensed.A)
    return replace(condensed, lu=factorise(condensed.A, order), order=order)


def factorise(A: sp.csr_array, order: Index) -> SuperLU:
    """The factors of A (n, n), in its precision, with the unknowns in that order."""
    return splu(
        A[order][:, order].tocsc(),
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def check_constants(mesh: Mesh, found: Array) -> None:
    """`found`, the solution of (u, v)_1 = (1, v)_0, has to be 1: on small domains K + M loses M.

    Raises InputError otherwise.
    """
    if not np.max(np.abs(found - 1)) <= CONSTANTS:
        polygon = mesh.polygon
        raise InputError(
            f"polygon '{polygon.name}' of diameter {polygon.diameter:.3g} with boundary edges down to "
            f"{np.diff(mesh.s).min():.3g} is too small for double precision, or too thin; scale it to a "
            "diameter of about 1, or take longer edges"
        )


def elimination_order(A: sp.csr_array, boundary: Index = NONE) -> Index:
    """(n,) node numbers: the interior by nested dissection, then the boundary, if any, as it is listed.

    Consecutive boundary nodes share an edge, so the elimination tree ends in their chain and SuperLU's
    postordering leaves them last.
    """
    interior = np.delete(np.arange(A.shape[0]), boundary)
    graph = A[interior][:, interior].tocoo()
    off = graph.row != graph.col
    if not np.any(off):
        return np.concatenate([interior, boundary])
    rows, neighbours = graph.row[off], graph.col[off]
    starts = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=len(interior)))])
    dissection, _ = pymetis.nested_dissection(pymetis.CSRAdjacency(starts, neighbours))
    return np.concatenate([interior[np.asarray(dissection)], boundary])


def last_block(lu: SuperLU, size: int) -> Array:
    """R (size, size) upper triangular with R^T R the Schur complement on the last `size` unknowns.

    A = L U with U = diag(pivots) L^T, so R is the last block of U with its rows over the pivots' roots.
    """
    first = lu.shape[0] - size
    last = np.arange(first, lu.shape[0])
    if not (np.array_equal(lu.perm_c[first:], last) and np.array_equal(lu.perm_r, lu.perm_c)):
        raise RuntimeError("SuperLU moved the boundary unknowns away from the end of the elimination")
    block = lu.U[:, first:][first:].toarray()
    return block / np.sqrt(np.diag(block))[:, None]
