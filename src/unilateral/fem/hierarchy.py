"""Nested spaces V_0, ..., V_L by uniform refinement of a mesh, and loads on the finest one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from unilateral.fem import refinement
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.fem.refinement import Array, Int32, Triangles
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import structured

BLOCK = 1 << 14
"""Triangles of the level before the last whose children are looked at together."""
FEWEST = 4
"""Squares in a unit of length that are not halved: coarser levels save nothing."""


@dataclass(frozen=True, eq=False)
class Level:
    """V_l, with n nodes, nb of them on the boundary.

    `A` (n, n) is the matrix of (., .)_1, its rows not sorted; `P` (n, N) the prolongation from the
    level before, the identity on level 0. `roundness` (n - N,) belongs to the new nodes: the sums over
    the triangles at their edges. `boundary` (nb,) and `s` (nb + 1,) are as in `Mesh`.
    """

    A: sp.csr_array
    P: sp.csr_array
    roundness: Array
    boundary: Int32
    s: Array

    @property
    def n(self) -> int:
        return int(self.A.shape[0])


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """Levels 0 to L, the nodes (n, 2) of level L, and its triangles in short.

    These are the nodes and the opposite edges, (T, 3) each, of the triangles of level L - 1; None where
    L = 0.
    """

    coarse: Mesh
    levels: list[Level]
    points: Array
    parents: tuple[Int32, Int32] | None

    @property
    def mesh(self) -> Mesh:
        """The finest mesh."""
        return self._with_triangles(slice(None))

    def parts(self) -> Iterator[Mesh]:
        """The finest mesh in blocks, each with all nodes and some of the triangles."""
        count = len(self.parents[0] if self.parents else self.coarse.triangles)
        for start in range(0, count, BLOCK):
            yield self._with_triangles(slice(start, start + BLOCK))

    def load(self, moments: Callable[[Mesh], Array]) -> Array:
        """(n,) values of (f, phi_i), from the moments (m, 3) of f against the hats on each part."""
        found = np.zeros(len(self.points))
        for part in self.parts():
            np.add.at(found, part.triangles, moments(part))
        return found

    def _with_triangles(self, block: slice) -> Mesh:
        if self.parents is None:
            return replace(self.coarse, triangles=self.coarse.triangles[block])
        nodes, edges = self.parents
        triangles = refinement.corners(self.levels[-2].n, nodes[block], edges[block])
        boundary = self.levels[-1].boundary.astype(np.intp)
        return Mesh(self.coarse.polygon, self.points, triangles.astype(np.intp), boundary, self.levels[-1].s)


def hierarchy(coarse: Mesh, refinements: int) -> Hierarchy:
    """The levels from a mesh on, each the uniform refinement of the one before."""
    A, P = sum(stiffness_and_mass(coarse)), sp.eye_array(coarse.n_nodes, format="csr")
    A = sp.csr_array((A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32)), shape=A.shape)
    levels = [Level(A, P, np.zeros(0), coarse.boundary.astype(np.int32), coarse.s)]
    points, of = coarse.points, None
    for _ in range(refinements):
        of = refinement.children(of) if of else refinement.triangles(coarse)
        points = np.concatenate([points, 0.5 * (points[of.ends[:, 0]] + points[of.ends[:, 1]])])
        levels.append(_finer(of, levels[-1]))
    return Hierarchy(coarse, levels, points, (of.nodes, of.edges) if of else None)


def of_squares(polygon: Polygon, h: float) -> Hierarchy:
    """Levels up to `structured(polygon, h)`, numbered otherwise, from as few squares as halving leads to.

    Raises InputError unless the polygon consists of unit squares between whole numbers.
    """
    n, refinements = int(square().counts(h)[0]), 0
    while n % 2 == 0 and n > FEWEST:
        n, refinements = n // 2, refinements + 1
    return hierarchy(structured(polygon, 1 / n), refinements)


def roundness(stiffness: Array) -> Array:
    """(T,) the ratio r <= 1 of the singular values of the map J from an equilateral triangle.

    r + 1/r = |J|^2 / det J is the sum of the squared sides over 2 3^{1/2} |T|; and that sum over 4 |T| is
    the trace of the element's stiffness matrix, whose rows add up to 0.
    """
    both = -4 / np.sqrt(3) * stiffness.sum(axis=1)
    return np.asarray(2 / (both + np.sqrt(np.maximum(both**2 - 4, 0))))


def _finer(of: Triangles, coarser: Level) -> Level:
    """The level whose triangles are the children of these."""
    middle = of.n + np.arange(of.inside, len(of.ends), dtype=np.int32)
    boundary = np.column_stack([coarser.boundary, middle]).ravel()
    s = coarser.s
    s = np.append(np.column_stack([s[:-1], 0.5 * (s[:-1] + s[1:])]), s[-1])
    P = refinement.prolongation(of)
    of_edges = of.on_edges(roundness(of.stiffness)[:, None])
    return Level(refinement.matrix(of, P), P, of_edges, boundary, s)
