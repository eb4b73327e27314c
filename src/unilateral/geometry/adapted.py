"""Meshes that are refined where it is needed, and the cells of T_H that follow.

Marked triangles are cut in four, others that this reaches in two or three, by scikit-fem. Nodes keep their
numbers, and boundary edges are halved. Places on the boundary are whole numbers: every edge of the first mesh
is UNIT long, and edges 0 and 1, 2 and 3, .. of it lie in one cell. So an edge of any later mesh is a dyadic
interval. It asks for its parent, twice as long; of nested parents the largest is a cell of T_H. Every edge
that meets a cell is then at most half of it, which keeps the pair of spaces stable. Where an edge is shorter
than a quarter of its cell, the cell's longest ones are halved, too: edges in geometric progression would be
one cell else.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.mesh import ROUNDED, Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.plane import signed_areas

UNIT = 2**39
"""Halvings of an edge end, by rounding, before it is 1 long."""
SHORTEST = 4
"""Times as long as its shortest edge a cell may be."""
BULK = 0.5
"""Of the sum of all shares: what those of the marked triangles usually are to be, at least."""


@dataclass(frozen=True, eq=False)
class AdaptedMesh:
    """A mesh whose boundary edge k lies between the places at[k] and at[k + 1], `at` (nb + 1,)."""

    mesh: Mesh
    at: Index

    @cached_property
    def cell(self) -> Index:
        """(nb,) the cell of each boundary edge."""
        length = np.diff(self.at)
        begin = self.at[:-1] // (2 * length) * (2 * length)
        order = np.lexsort([-length, begin])
        reach = np.maximum.accumulate((begin + 2 * length)[order])
        cell = np.empty(len(order), dtype=np.intp)
        cell[order] = np.cumsum(np.append(True, begin[order][1:] >= reach[:-1])) - 1
        return cell

    @cached_property
    def partition(self) -> Partition:
        first = np.flatnonzero(np.append(True, np.diff(self.cell) > 0))
        return Partition(self.mesh.polygon, self.mesh.s[np.append(first, -1)])

    @cached_property
    def inside(self) -> Index:
        """(cells,) a node inside each cell, that with the longest edges."""
        both = np.diff(self.mesh.s) + np.roll(np.diff(self.mesh.s), 1)
        within = np.flatnonzero(self.cell == np.roll(self.cell, 1))
        order = within[np.argsort(both[within], kind="stable")]
        found = np.empty(self.partition.n_cells, dtype=np.intp)
        found[self.cell[order]] = self.mesh.boundary[order]
        return found

    @property
    def unbalanced(self) -> Index:
        """The triangles at the edges that are too long for a shorter one in their cell."""
        length = np.diff(self.at)
        total, shortest = np.zeros((2, self.cell[-1] + 1), dtype=np.int64)
        np.add.at(total, self.cell, length)
        shortest[:] = total
        np.minimum.at(shortest, self.cell, length)
        long = (2 * length >= total[self.cell]) & (total > SHORTEST * shortest)[self.cell]
        return self.mesh.boundary_triangles[long]


def adapted(mesh: Mesh) -> AdaptedMesh:
    """The first mesh, two of whose boundary edges, of the same length, make a cell."""
    return AdaptedMesh(mesh, UNIT * np.arange(len(mesh.s), dtype=np.int64))


def marked(mesh: Mesh, shares: Array, bulk: float = BULK) -> Index:
    """The fewest triangles with that part of the sum of all shares (m,) (Doerfler, SINUM 33, 1996).

    Without those whose edges are as short as rounding; raises InputError if none is left.
    """
    shortest = float(np.spacing(np.abs(mesh.polygon.vertices).max())) / ROUNDED
    order = np.argsort(-shares, kind="stable")
    found = order[: np.searchsorted(np.cumsum(shares[order]), bulk * shares.sum()) + 1]
    found = found[mesh.longest_edges[found] > shortest]
    if found.size == 0:
        raise InputError(
            f"the triangles of '{mesh.polygon.name}' from which most of the bound comes have edges of "
            f"{shortest:.2g}, as short as rounding allows; take a larger accuracy"
        )
    return found


def refined(of: AdaptedMesh, chosen: Index, values: Array) -> tuple[AdaptedMesh, Array]:
    """With the chosen triangles halved, and what else that needs; and the nodal values (n,) interpolated."""
    while chosen.size:
        of, values = _halved(of, chosen, values)
        chosen = of.unbalanced
    return of, values


def _halved(of: AdaptedMesh, chosen: Index, values: Array) -> tuple[AdaptedMesh, Array]:
    import skfem  # which only adapted meshes need

    mesh, n, edges = of.mesh, of.mesh.n_nodes, of.mesh.triangulation
    found = skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy()).refined(np.unique(chosen))
    points, triangles = found.p.T.copy(), found.t.T.astype(np.intp)
    clockwise = signed_areas(points, triangles) < 0
    triangles[clockwise] = triangles[clockwise][:, [0, 2, 1]]
    edge = _at(mesh.points[edges.ends].mean(axis=1), points[n:])
    node = n + np.flatnonzero(edge >= edges.inside)
    k = edge[node - n] - edges.inside
    middle = AdaptedMesh(
        Mesh(
            mesh.polygon,
            points,
            triangles,
            np.insert(mesh.boundary, k + 1, node),
            np.insert(mesh.s, k + 1, 0.5 * (mesh.s[k] + mesh.s[k + 1])),
        ),
        np.insert(of.at, k + 1, (of.at[k] + of.at[k + 1]) // 2),
    )
    return middle, np.append(values, values[edges.ends[edge]].mean(axis=1))


def _at(places: Array, points: Array) -> Index:
    """(k,) which of the places (e, 2) the points (k, 2) are: the same numbers, for both are midpoints."""
    of_places, of_points = (np.ascontiguousarray(x).view(complex).ravel() for x in (places, points))
    order = np.argsort(of_places)
    return np.asarray(order[np.searchsorted(of_places, of_points, sorter=order)])
