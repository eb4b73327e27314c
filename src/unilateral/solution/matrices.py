"""The matrices of the discrete problem (P_h*), as a solver of one's own needs them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index
from unilateral.discrete.base import DiscreteProblem
from unilateral.fem.p1 import coupling, stiffness_and_mass
from unilateral.fem.spaces import DualOperator


@dataclass(frozen=True, eq=False)
class Matrices:
    """A u - B^T lambda = F, lambda >= 0, B u >= H g, and lambda . (B u - H g) = 0, for u (n,), lambda (m,).

    `A` (n, n) is k times the stiffness plus c times the mass matrix. B[i, j] of `B` (m, n) is the integral of
    node j's hat over cell i. `F` (n,) is the load of f and of the flux q, and `g` (m,) has the means of g on
    the cells, whose lengths are `H` (m,). The m `cells` (m,) are those of the partition that lie on no free
    or clamped side. At nodes on clamped sides u is given in place of an equation; A and B in `D` are without
    these.

    >>> import numpy as np
    >>> import unilateral as ul
    >>> solver = ul.Solver("natural", h=1 / 16, H=1 / 8, stop=ul.Stop(algorithm="active_set"))
    >>> s, m = solver(), solver.matrices()
    >>> lambda_H, gap = s.multiplier[m.cells], m.B @ s.u - m.H * m.g
    >>> residual = m.A @ s.u - m.B.T @ lambda_H - m.F
    >>> bool(np.abs(residual).max() < 1e-12), bool(lambda_H.min() >= 0), bool(gap.min() > -1e-12)
    (True, True, True)
    >>> bool(np.abs(lambda_H * gap).max() < 1e-12)
    True
    >>> bool(np.allclose(m.D @ lambda_H + m.B @ np.linalg.solve(m.A.toarray(), m.F), m.B @ s.u))
    True
    """

    A: sp.csr_array
    B: sp.csr_array
    F: Array
    g: Array
    H: Array
    cells: Index
    _make_operator: Callable[[], DualOperator]

    def __repr__(self) -> str:
        m, n = self.B.shape
        return f"Matrices: A ({n}, {n}), B ({m}, {n}), F ({n},), g, H and cells ({m},), D and S ({m}, {m})"

    @cached_property
    def D(self) -> Array:
        """The dense matrix B A^{-1} B^T (m, m) of the dual problem."""
        return self._make_operator().D

    @cached_property
    def S(self) -> Array:
        """D (m, m) with rows and columns divided by H^{1/2}, for H^{1/2} lambda as unknowns."""
        root = np.sqrt(self.H)
        return self.D / root[:, None] / root


def assemble_matrices(discrete: DiscreteProblem, make_operator: Callable[[], DualOperator]) -> Matrices:
    """Matrices, load and means of g of a discrete problem."""
    mesh = discrete.mesh
    partition = discrete.partition
    form = discrete.form
    stiffness, mass = stiffness_and_mass(mesh)
    cells = discrete.cells
    # B has columns for all nodes, `coupling` for those of the boundary
    coupled = coupling(mesh, partition)[cells].tocoo()
    shape = (len(cells), mesh.n_nodes)
    B = sp.coo_array((coupled.data, (coupled.row, mesh.boundary[coupled.col])), shape=shape).tocsr()
    return Matrices(
        A=(form.k * stiffness + form.c * mass).tocsr(),
        B=B,
        F=discrete.load,
        g=discrete.g_means[cells],
        H=partition.lengths[cells],
        cells=cells,
        _make_operator=make_operator,
    )
