"""Partial elimination of the interior unknowns (the paper, section 5): A c = g becomes A_3 c'' = g'',
and the dual operator D = B A_3^{-1} B^T on the cells of T_H.

The interior is ordered by nested dissection and the boundary comes last, so that one sparse LU
factorisation carries the Schur complement A_3 in the last block of its factors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pymetis
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import cho_solve, eigvalsh, solve_triangular
from scipy.sparse.linalg import SuperLU, splu

from unilateral.errors import InputError
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition

Array = NDArray[np.float64]
Ints = NDArray[np.intp]

NONE = np.empty(0, dtype=np.intp)
CONSTANTS = 1e-8
"""How accurately constants must be solved for; what is guaranteed is so up to this rounding of A_3."""
SINGULAR = 1e-12
"""lambda_min / lambda_max of S below which beta counts as 0."""


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
    order: Ints

    def solve(self, rhs: Array) -> Array:
        """A^{-1} rhs on all nodes, for rhs (n,) or (n, k)."""
        solution = np.empty_like(rhs, dtype=float)
        solution[self.order] = self.lu.solve(np.asarray(rhs[self.order], dtype=float))
        return solution

    def solve_boundary(self, rhs: Array) -> Array:
        """A_3^{-1} rhs for rhs (nb,) or (nb, k)."""
        return cho_solve((self.cholesky, False), rhs)

    def condensed_load(self, load: Array) -> Array:
        """The paper's g'' (nb,) of a load (n,) on all nodes."""
        return self.A_3 @ self.solve(load)[self.mesh.boundary]


@dataclass(frozen=True, eq=False)
class DualOperator:
    """D = half^T half (m, m) of one mesh and partition, the cells' lengths H_i (m,), and |Omega|.

    mu . D mu is the squared discrete norm ||mu||_{-1/2,h} = sup over V_h of <mu, v> / ||v||_1; column i of
    `half` (nb, m) is the boundary response to a unit load on cell i, measured in (A_3)^{1/2}.
    """

    half: Array
    H_i: Array
    area: float

    @cached_property
    def D(self) -> Array:
        """(m, m), symmetric and semidefinite."""
        return self.half.T @ self.half

    @cached_property
    def S(self) -> Array:
        """(m, m) D on the unknowns H_i^{1/2} mu_i, whose Euclidean norm is ||mu||_0."""
        root = np.sqrt(self.H_i)
        return self.D / root[:, None] / root

    @cached_property
    def spectrum(self) -> Array:
        """(m,) eigenvalues of S, ascending."""
        return eigvalsh(self.S)

    @property
    def lambda_min(self) -> float:
        return float(self.spectrum[0])

    @property
    def lambda_max(self) -> float:
        return float(self.spectrum[-1])

    @property
    def singular(self) -> bool:
        """Whether S, and with it beta, is zero on some mu, to rounding."""
        return self.lambda_min <= SINGULAR * self.lambda_max

    def gap(self, mu: Array, offset: Array) -> Array:
        """F (m,): the cell means of u(mu) - g, the offset being F(0); one application of D."""
        return self.D @ mu / self.H_i + offset


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


def factorise(A: sp.csr_array, order: Ints) -> SuperLU:
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


def dual_operator(condensed: Condensed, partition: Partition, B: sp.csr_array) -> DualOperator:
    """The dual operator for B (m, nb) of `coupling`."""
    half = solve_triangular(condensed.cholesky, B.T.toarray(), trans="T", check_finite=False)
    return DualOperator(half, partition.lengths, condensed.mesh.polygon.area)


def elimination_order(A: sp.csr_array, boundary: Ints = NONE) -> Ints:
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
