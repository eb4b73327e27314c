"""Conjugate gradients for one set of active cells, in the kernel of their constraints.

For the active cells a they find the solution u_a of A u = load + B_a^T lambda, B_a u = d_a. The first u
fulfils the constraints; all steps are in the kernel of B_a. There the residual r = load + B_a^T lambda - A u
matters only up to the range of B_a^T, and its part in that range moves into lambda. The preconditioner is the
symmetric product of corrections in that kernel, each of them orthogonal in the energy:

    the ring, the nodes on the boundary: exactly, by the saddle-point matrix of A and B_a on them;
    nodes inside whose hats changed, one after another, forward first and backward last (Gauss and Seidel);
    the coarser levels, truncated at the nodes of active cells.

So its eigenvalues lie in (0, 1], and (r . z)^{1/2} <= ||u - u_a||_1 for the preconditioned residual z.
On level 0 the ring consists of all nodes, and the first u is u_a.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from pyamg.amg_core import gauss_seidel_indexed
from scipy.linalg.blas import daxpy, dnrm2
from scipy.sparse.linalg import splu

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.hierarchy import Hierarchy
from unilateral.fem.nested_cells import LevelCells
from unilateral.solvers.v_cycle import TruncatedCycle

MEAN_ROUNDING = 1e-13
"""A mean of g - u over a cell is no violation up to this fraction of the largest |u|."""
MAX_KERNEL_ITERATIONS = 200


@dataclass(frozen=True, eq=False)
class Grid:
    """The problem on the last level of a hierarchy: load (n,), and integrals d (m,) of g over its cells."""

    hierarchy: Hierarchy
    cells: LevelCells
    load: Array
    d: Array

    @property
    def is_coarsest(self) -> bool:
        """Whether the ring consists of all nodes."""
        return not self.hierarchy.levels

    @cached_property
    def ring(self) -> Index:
        """The nodes of the ring, increasing: those on the boundary, or all on level 0; shape (k,)."""
        return np.arange(self.hierarchy.n) if self.is_coarsest else np.sort(self.hierarchy.boundary)

    @cached_property
    def ring_rows(self) -> sp.csr_array:
        """The rows of A at the nodes of the ring; shape (k, n)."""
        return self.hierarchy.A[self.ring]


class ActiveSetRun:
    """Conjugate gradients for the cells `active` (m,), from u (n,), which changes in place.

    `rz` is r . z, and `first_rz` its first value; `multiplier` belongs to the active cells. `cg_coefficients`
    are the numbers alpha and beta of each step.
    """

    def __init__(self, grid: Grid, active: Mask, u: Array) -> None:
        self.grid = grid
        self.active = active
        self.u = u
        B = grid.cells.B[active]
        self.B_T = B[:, grid.ring].T.tocsr()
        A = grid.ring_rows[:, grid.ring]
        # A grows with k, B with lengths: for other units the matrix is the same up to a factor
        largest = abs(self.B_T).max() if B.shape[0] else 1.0
        self.scale = 2.0 ** np.rint(np.log2(abs(A).max() / largest))
        # (A B_a^T; B_a 0) on the ring, or A if no cell is active
        B_T = self.scale * self.B_T
        saddle = sp.block_array([[A, B_T], [B_T.T, None]], format="csc") if B.shape[0] else A.tocsc()
        self.saddle_factors = splu(saddle)
        self.coarse_correction = (
            None if grid.is_coarsest else TruncatedCycle(grid.hierarchy, grid.cells.nodes(active))
        )
        # a first step on the ring fulfils the constraints; all others are in the kernel of B_a
        self.multiplier = np.zeros(B.shape[0])
        self.r = grid.load - grid.hierarchy.A @ u
        change = self._correct_ring(grid.d[active] - B @ u)
        u[grid.ring] += change
        self.r -= grid.ring_rows.T @ change
        self.p = self._precondition_residual()
        self.rz = self.first_rz = float(self.r @ self.p)
        self.cg_coefficients: list[tuple[float, float]] = []

    @property
    def lambda_H(self) -> Array:
        """The multiplier on all cells, which may be negative; shape (m,)."""
        lambda_H = np.zeros(len(self.active))
        lambda_H[self.active] = self.multiplier
        return lambda_H

    @property
    def is_exhausted(self) -> bool:
        """Whether no further step is made."""
        return len(self.cg_coefficients) >= MAX_KERNEL_ITERATIONS or not self.rz > 0

    @property
    def residual_norm(self) -> float:
        """The weighted norm (sum r_i^2 / m_i)^{1/2} of the residual."""
        return float(dnrm2(self.r / np.sqrt(self.grid.hierarchy.nodal_weights)))

    def descend(self, max_rz: float) -> None:
        """Make steps until r . z is at most `max_rz`."""
        while self.rz > max_rz and not self.is_exhausted:
            self._advance()

    def choose_next_set(self) -> Mask:
        """Which cells (m,) are active next."""
        # active ones stay where lambda_H > 0, others become so where the mean of u is below the mean of g
        cells = self.grid.cells
        rounding = MEAN_ROUNDING * np.max(np.abs(self.u))
        below = cells.B @ self.u - self.grid.d < -rounding * cells.lengths
        return np.where(self.active, self.lambda_H > 0, below)

    def _advance(self) -> None:
        """Make one step: u + alpha p, alpha = r . z / p . A p; then p = z + beta p with the new r and z."""
        A_p = self.grid.hierarchy.A @ self.p
        alpha = self.rz / float(self.p @ A_p)
        daxpy(self.p, self.u, a=alpha)
        daxpy(A_p, self.r, a=-alpha)
        z = self._precondition_residual()
        old = self.rz
        self.rz = float(self.r @ z)
        self.p *= self.rz / old
        self.p += z
        self.cg_coefficients.append((alpha, self.rz / old))

    def _correct_ring(self, gap: Array) -> Array:
        """x (k,) on the ring with B_a x = gap. Its residual there is B_a^T t, and t moves into lambda."""
        ring = self.grid.ring
        x, t = np.split(self.saddle_factors.solve(np.append(self.r[ring], self.scale * gap)), [len(ring)])
        self.multiplier -= self.scale * t
        self.r[ring] -= self.B_T @ (self.scale * t)
        return np.asarray(x)

    def _precondition_residual(self) -> Array:
        """The preconditioned residual z (n,). What B_a^T reaches of r moves into the multiplier first."""
        grid = self.grid
        z = np.zeros_like(self.r)
        ring = grid.ring
        zero = np.zeros_like(self.multiplier)
        # symmetric: ring, inner nodes forward, coarser levels, inner nodes backward, ring
        z[ring] = self._correct_ring(zero)
        if self.coarse_correction:
            last = len(grid.hierarchy.smoothed_nodes)
            self._sweep_inner_nodes(z, 0, last, 1)
            self.coarse_correction.correct(grid.hierarchy.A, z, self.r)
            self._sweep_inner_nodes(z, last - 1, -1, -1)
            # z only: r does not change any more, so the multiplier of this correction is dropped
            ring_residual = self.r[ring] - grid.ring_rows @ z
            z[ring] += self.saddle_factors.solve(np.concatenate([ring_residual, zero]))[: len(ring)]
        return z

    def _sweep_inner_nodes(self, z: Array, start: int, stop: int, step: int) -> None:
        """One sweep of Gauss and Seidel for A z = r, over the inner nodes whose hats changed last."""
        A = self.grid.hierarchy.A
        nodes = self.grid.hierarchy.smoothed_nodes
        gauss_seidel_indexed(A.indptr, A.indices, A.data, z, self.r, nodes, start, stop, step)
