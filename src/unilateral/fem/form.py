"""The bilinear form of a problem, and the functions it is for: those that vanish on clamped sides.

It also says where multipliers are: on sides that are neither clamped nor free.

With c > 0 the scaled problem (`problems.units`) has the form (., .)_1 of (1.1). With c = 0 it is
(grad ., grad .)_0, a scalar product of functions that vanish on a side. Their ||v|| = (v, v)^{1/2} is the
energy norm in both cases.

Matrices are those of all hats, with 0 in the rows and columns of the `fixed` nodes but for the diagonal. So a
vector that is 0 there stays so, and nothing else has to know which nodes are fixed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index, Mask
from unilateral.geometry.mesh import Mesh


class Form(NamedTuple):
    """(v, w) = (grad v, grad w)_0 + reaction (v, w)_0, the reaction 1 or 0, where v, w = 0 if `clamped`.

    Forces are bounded with another weight in the place of the reaction. `friedrichs` is a number C with
    ||v||_0 <= C ||v||: 1 if no side is clamped, else that of `poincare` if c = 0 or it is smaller. There are
    no multipliers on `free` sides.
    """

    reaction: float = 1.0
    clamped: tuple[int, ...] = ()
    friedrichs: float = 1.0
    free: tuple[int, ...] = ()

    @property
    def of_H1(self) -> float:
        """A number C with ||v||_1 <= C ||v||."""
        return 1.0 if self.reaction else math.hypot(1.0, self.friedrichs)

    def held(self, side: Index) -> Mask:
        """(k,) on which of these sides (k,) there are multipliers."""
        return ~np.isin(side, self.clamped + self.free)

    def edges(self, mesh: Mesh) -> Mask:
        """(nb,) which boundary edges are clamped."""
        return np.isin(mesh.side, self.clamped)

    def fixed(self, mesh: Mesh) -> Mask:
        """(n,) which nodes lie on clamped sides."""
        fixed, edges = np.zeros(mesh.n_nodes, dtype=bool), self.edges(mesh)
        fixed[mesh.boundary[edges | np.roll(edges, 1)]] = True
        return fixed


H1 = Form()
"""The form (., .)_1 on H^1."""


def decoupled(A: sp.csr_array, fixed: Mask) -> sp.csr_array:
    """A (n, n) with 0 in the rows and columns of the `fixed` (n,), but for the diagonal."""
    if not fixed.any():
        return A
    rows = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    off = (fixed[rows] | fixed[A.indices]) & (rows != A.indices)
    return sp.csr_array((np.where(off, 0.0, A.data), A.indices, A.indptr), shape=A.shape)


def row_sums(A: sp.csr_array, whole: Array, fixed: Mask) -> Array:
    """(n,) the sums of the rows of a `decoupled` A, from those (n,) of the whole matrix."""
    beside = np.add.reduceat(fixed[A.indices], A.indptr[:-1], dtype=int) > 0
    return np.where(beside, A.sum(axis=1), whole)
