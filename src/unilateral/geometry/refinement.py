"""Triangulations that know their edges, and their uniform refinement without sorting anything.

Red refinement cuts every triangle into four similar ones. Nodes of the finer level: those of the coarser,
with their numbers, then the midpoint of every edge. Edges on the boundary have the last numbers, in their
order along it. Triangle t becomes 4 t, ..., 4 t + 3. Child i < 3 lies at node i; node i of the last child,
the middle one, is the midpoint of the edge opposite to node i. So every child is its parent halved, the
middle one also turned by 180 degrees.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32

CORNERS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""A node of a triangle and the two after it."""
CONGRUENT = 1e-13
"""Of the longest edge: how far apart rounding leaves the edges of congruent triangles."""


FEW = 1000
"""Triangles that are looked at first: where they are not alike, all are not."""


class Triangulation(NamedTuple):
    """Of n nodes: the triangles' nodes (T, 3) and opposite edges (T, 3), and the edges' ends (E, 2).

    The first `inside` edges are not on the boundary. If all triangles are `alike`, see `turned`.
    """

    n: int
    nodes: Int32
    edges: Int32
    ends: Int32
    inside: int
    alike: bool

    @property
    def halves(self) -> Int32:
        """(E,) the child edge at the first end of each edge; that at the second end is the next one.

        Children are numbered: halves of edges inside, three edges within each triangle, halves of the others.
        """
        found = 2 * np.arange(len(self.ends), dtype=np.int32)
        found[self.inside :] += 3 * len(self.nodes)
        return found

    def children(self) -> Triangulation:
        """The triangulation refined once."""
        a, b = self.ends.T
        middle = self.n + np.arange(len(a), dtype=np.int32)
        halves = np.stack([a, middle, middle, b], axis=1).reshape(-1, 2)
        within = self.n + self.edges[:, [1, 2, 2, 0, 0, 1]].reshape(-1, 2)
        half, two = self.halves, 2 * self.inside
        edges = np.empty((len(self.nodes), 4, 3), dtype=np.int32)
        for i, *others in CORNERS:
            edges[:, i, i] = edges[:, 3, i] = two + np.arange(i, self.nodes.size, 3)
            for j in others:
                edges[:, i, j] = half[self.edges[:, j]] + (b[self.edges[:, j]] == self.nodes[:, i])
        return Triangulation(
            self.n + len(a),
            self.corners_of_children(),
            edges.reshape(-1, 3),
            np.concatenate([halves[:two], within, halves[two:]]),
            two + self.nodes.size,
            self.alike,
        )

    def corners_of_children(self) -> Int32:
        """(4 T, 3) the nodes of the children."""
        found = np.empty((len(self.nodes), 4, 3), dtype=np.int32)
        for i, j, k in CORNERS:
            found[:, i, i], found[:, 3, i] = self.nodes[:, i], self.n + self.edges[:, i]
            found[:, i, j], found[:, i, k] = self.n + self.edges[:, k], self.n + self.edges[:, j]
        return found.reshape(-1, 3)

    def sums(self, values: Array) -> Array:
        """(E,) sums over the triangles at each edge of values (T, 3), or (T, 1) for all three edges."""
        of_each = np.broadcast_to(values, self.edges.shape)
        return np.bincount(self.edges.ravel(), of_each.ravel(), len(self.ends)).astype(float, copy=False)


def triangulation(points: Array, triangles: Index, boundary: Index) -> Triangulation:
    """Of triangles (T, 3) and the nodes (nb,) along the boundary; here the edges are sorted."""
    nodes, alike = turned(points, triangles)
    n, place = len(points), np.array([len(points), 1])
    opposite = np.sort(nodes[:, [[1, 2], [2, 0], [0, 1]]], axis=2) @ place
    along = np.column_stack([boundary, np.roll(boundary, -1)])
    order = np.argsort(opposite, axis=None)
    in_order = opposite.ravel()[order]
    first = np.append(True, in_order[1:] != in_order[:-1])
    numbers = in_order[first]
    of_boundary = np.searchsorted(numbers, np.sort(along, axis=1) @ place)
    inside = np.delete(np.arange(len(numbers)), of_boundary)
    new = np.empty(len(numbers), dtype=np.int32)
    new[np.concatenate([inside, of_boundary])] = np.arange(len(numbers))
    edges = np.empty(nodes.shape, dtype=np.int32)
    edges.ravel()[order] = new[np.cumsum(first) - 1]
    ends = np.concatenate([np.column_stack(np.divmod(numbers[inside], n)), along]).astype(np.int32)
    return Triangulation(n, nodes.astype(np.int32), edges, ends, len(inside), alike)


def turned(points: Array, triangles: Index) -> tuple[Index, bool]:
    """Triangles (T, 3), their corners in such an order that all are alike; as they are where none is so.

    Alike are triangles that a shift, or a turn by 180 degrees and a shift, takes to each other.
    """
    if len(triangles) > FEW and not turned(points, triangles[:FEW])[1]:
        return triangles, False
    sides = np.roll(points[triangles], -1, axis=1) - points[triangles]
    alike, found = np.zeros(len(triangles), dtype=bool), triangles.copy()
    for turn in range(3):
        moved = np.roll(sides, -turn, axis=1)
        apart = [np.abs(moved - sign * sides[0]).max(axis=(1, 2)) for sign in (1, -1)]
        new = ~alike & (np.minimum(*apart) <= CONGRUENT * np.abs(sides).max())
        found[new], alike = np.roll(triangles, -turn, axis=1)[new], alike | new
    return (found, True) if alike.all() else (triangles, False)
