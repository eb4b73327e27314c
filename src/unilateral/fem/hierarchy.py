"""Nested spaces V_0, ..., V_L on a mesh that was made by uniform refinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Int32
from unilateral.fem.inherited import Elements, elements, lumped, matrix, prolongation
from unilateral.fem.p1 import lumped_mass, stiffness_and_mass
from unilateral.geometry.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Level:
    """V_l, with n nodes, nb of them on the boundary.

    `A` (n, n) is the matrix of (., .)_1, its rows not sorted, `mass` (n,) their sums; `P` (n, N) the
    prolongation from the level before, the identity on level 0. `roundness` (n - N,) belongs to the new
    nodes: the sums over the triangles at their edges. `boundary` (nb,) and `s` (nb + 1,) are as in `Mesh`.
    """

    A: sp.csr_array
    mass: Array
    P: sp.csr_array
    roundness: Array
    boundary: Int32
    s: Array

    @property
    def n(self) -> int:
        return int(self.A.shape[0])


def hierarchy(mesh: Mesh) -> list[Level]:
    """The levels from the coarse mesh that it was refined from, to the mesh itself."""
    coarse = mesh.coarse or mesh
    A, P = sum(stiffness_and_mass(coarse)), sp.eye_array(coarse.n_nodes, format="csr")
    A = sp.csr_array((A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32)), shape=A.shape)
    levels = [Level(A, lumped_mass(coarse), P, np.zeros(0), coarse.boundary.astype(np.int32), coarse.s)]
    of = elements(coarse) if mesh.halvings else None
    while of:
        every = 2 ** (mesh.halvings - len(levels))
        boundary = mesh.boundary[::every].astype(np.int32)
        levels.append(_finer(of, boundary, mesh.s[::every]))
        of = of.children() if every > 1 else None
    return levels


def roundness(stiffness: Array) -> Array:
    """(T,) the ratio r <= 1 of the singular values of the map J from an equilateral triangle.

    r + 1/r = |J|^2 / det J is the sum of the squared sides over 2 3^{1/2} |T|; and that sum over 4 |T| is
    the trace of the element's stiffness matrix, whose rows add up to 0.
    """
    both = -4 / np.sqrt(3) * stiffness.sum(axis=1)
    return np.asarray(2 / (both + np.sqrt(np.maximum(both**2 - 4, 0))))


def _finer(coarser: Elements, boundary: Int32, s: Array) -> Level:
    """The level whose triangles are the children of these."""
    P = prolongation(coarser.of)
    of_edges = coarser.of.sums(roundness(coarser.stiffness)[:, None])
    return Level(matrix(coarser, P), lumped(coarser), P, of_edges, boundary, s)
