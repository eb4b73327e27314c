"""The discrete problem on any mesh, by active sets; each system by conjugate gradients, or sparse factors.

Find u in V_h and lambda_H >= 0, one number per cell, with A u = load + B^T lambda, B u >= d and
lambda . (B u - d) = 0; A is the matrix of (., .)_1, B u and d are integrals of u and g over the cells.

On an active cell B u = d, which gives u at one node inside it from the others at the cell. That leaves one
positive definite system for a set of active cells, and at such a node the residual is lambda. The next set
are the active cells that are pressed, lambda > 0, and the others on which u lies below g: the primal-dual
active set. That the sets settle is not proved, and always seen.

The end is guaranteed, for any u and lambda >= 0, whatever the set. As in `multigrid` v = u - w fulfils
B v >= d and lambda . (B v - d) = 0, and ||u - u_h||_1 and ||lambda - lambda_H||_{-1/2,h} are at most
||R|| + ||w||_1 with R = A v - load - B^T lambda and its dual norm on V_h, for which see `rounded`. That is
too large by up to 1/h, h the shortest edge, but a few more steps make up for it. Rounding is in the bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.rounded import dual_norm
from unilateral.solvers.descent import solved
from unilateral.solvers.feasible import feasible

ROUNDING = 1e-13
"""Of the largest |u|: a mean of g - u of that size is no violation."""
AIM = 0.9
"""Of the tolerance: what the steps' own residuals are to be, which differ from R by rounding."""
MOST_SETS = 40


@dataclass(frozen=True, eq=False)
class System:
    """A (n, n), load (n,), B (m, n), d (m,).

    `inside` (m,) is a node in each cell, `mass` (n,) are the sums of A's rows.
    """

    A: sp.csr_array
    load: Array
    B: sp.csr_array
    d: Array
    inside: Index
    mass: Array

    @cached_property
    def weights(self) -> Array:
        """(m,) the integrals of the hats at the nodes inside."""
        return np.asarray(self.B[np.arange(len(self.d)), self.inside]).ravel()

    def bound(self, u: Array, lambda_H: Array) -> float:
        """Guaranteed, of both errors, for any u (n,) and lambda_H (m,) >= 0."""
        R, norm = feasible(self.A, self.mass, self.load, self.B, self.d, self.inside, u, lambda_H)
        return dual_norm(np.abs(R.values) + R.doubt, self.mass) + norm

    def next_set(self, u: Array, active: Mask, lambda_H: Array) -> Mask:
        """(m,) the active cells that are pressed, and the others on which u lies below g."""
        below = self.B @ u - self.d < -ROUNDING * np.max(np.abs(u), initial=0.0) * self.B.sum(axis=1)
        return np.where(active, lambda_H > 0, below)


@dataclass(frozen=True, eq=False)
class Settled:
    """u (n,), lambda_H (m,) >= 0, their guaranteed bound; how many systems, and steps, it took."""

    u: Array
    lambda_H: Array
    bound: float
    systems: int
    steps: int


def settled(system: System, u: Array, active: Mask, tolerance: float) -> Settled:
    """From u (n,) and active cells (m,), until a set stays the same with a bound of at most the tolerance.

    If rounding, MOST_SETS or too many steps end it before, the bound is larger.
    """
    systems = steps = 0
    while True:
        u, lambda_H, more = _on(system, active, u, AIM * tolerance)
        after, systems, steps = system.next_set(u, active, lambda_H), systems + 1, steps + more
        if np.array_equal(after, active) or systems == MOST_SETS:
            break
        active = after
    lambda_H = np.maximum(lambda_H, 0)
    return Settled(u, lambda_H, system.bound(u, lambda_H), systems, steps)


def riesz(system: System, R: Array, tolerance: float) -> Array:
    """v (n,) with A v = R (n,), up to the tolerance."""
    return solved(system.A, R, np.zeros(len(R)), system.mass, tolerance**2 / 4)[0]


def _on(system: System, active: Mask, u: Array, tolerance: float) -> tuple[Array, Array, int]:
    """u (n,), lambda (m,) of any sign, and the steps, for one set of active cells."""
    n, m, cells = len(u), len(active), np.flatnonzero(active)
    nodes, weights = system.inside[cells], system.weights[cells]
    free = np.delete(np.arange(n), nodes)
    rows = sp.csr_array((1 / weights, (nodes, np.arange(len(cells)))), shape=(n, len(cells)))
    chosen = sp.csr_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(n, len(free)))
    B = system.B[cells]
    T, shift = (chosen - rows @ B[:, free]).tocsr(), rows @ system.d[cells]
    rhs = T.T @ (system.load - system.A @ shift)
    y, steps = solved((T.T @ system.A @ T).tocsr(), rhs, u[free], system.mass[free], tolerance**2 / 4)
    u = T @ y + shift
    lambda_H = np.zeros(m)
    lambda_H[cells] = (system.A[nodes] @ u - system.load[nodes]) / weights
    return u, lambda_H, steps
