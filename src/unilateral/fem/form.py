"""The bilinear form of a problem, and the functions it is for: those that vanish on clamped sides.

It also says where multipliers are: on sides that are neither clamped nor free.

The form is (v, w) = k (grad v, grad w)_0 + c (v, w)_0, that of (1.1) for k = c = 1. It is a scalar product,
for c > 0 or a side is clamped. ||v|| = (v, v)^{1/2} is the energy norm.

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
    """(v, w) = k (grad v, grad w)_0 + c (v, w)_0 for functions that vanish on the `clamped` sides.

    There are no multipliers on the `free` sides. `friedrichs` is a number C with ||v||_0 <= C |v|_1 for these
    functions; it is infinite where no side is clamped, and may be so where c > 0.
    """

    k: float = 1.0
    c: float = 1.0
    clamped: tuple[int, ...] = ()
    free: tuple[int, ...] = ()
    friedrichs: float = math.inf

    @property
    def coercivity(self) -> float:
        """A number m > 0 with m ||v||_0^2 <= ||v||^2: c + k / C^2."""
        return self.c + self.k / self.friedrichs**2

    @property
    def value_constant(self) -> float:
        """A number W with ||v||_0 <= W ||v||."""
        return self.coercivity**-0.5

    @property
    def length_scale(self) -> float:
        """The length (k / m)^{1/2} for the coercivity m, at most (k/c)^{1/2} and Friedrichs' constant."""
        return math.sqrt(self.k / self.coercivity)

    def has_multiplier(self, sides: Index) -> Mask:
        """Whether each of these sides carries a multiplier: it is neither clamped nor free; shape (k,)."""
        return ~np.isin(sides, self.clamped + self.free)

    def clamped_edges(self, mesh: Mesh) -> Mask:
        """Whether each boundary edge lies on a clamped side; shape (nb,)."""
        return np.isin(mesh.side, self.clamped)

    def clamped_nodes(self, mesh: Mesh) -> Mask:
        """Whether each node lies on a clamped side; shape (n,)."""
        is_clamped = np.zeros(mesh.n_nodes, dtype=bool)
        edges = self.clamped_edges(mesh)
        # edge e begins at boundary node e, and ends at node e + 1
        is_clamped[mesh.boundary[edges | np.roll(edges, 1)]] = True
        return is_clamped


H1 = Form()
"""The form (., .)_1 on H^1."""


def decouple_nodes(A: sp.csr_array, fixed: Mask) -> sp.csr_array:
    """A (n, n) with 0 in the rows and columns of the `fixed` nodes (n,), but for the diagonal."""
    if not fixed.any():
        return A
    rows = np.repeat(np.arange(A.shape[0]), np.diff(A.indptr))
    decoupled = (fixed[rows] | fixed[A.indices]) & (rows != A.indices)
    return sp.csr_array((np.where(decoupled, 0.0, A.data), A.indices, A.indptr), shape=A.shape)


def decoupled_row_sums(A: sp.csr_array, full_row_sums: Array, fixed: Mask) -> Array:
    """The sums (n,) of the rows of a decoupled matrix, from those of the matrix before it was decoupled.

    Only rows that meet `fixed` nodes (n,) are added up, with more rounding. No row is empty.
    """
    meets_fixed = np.add.reduceat(fixed[A.indices], A.indptr[:-1], dtype=int) > 0
    return np.where(meets_fixed, A.sum(axis=1), full_row_sums)
