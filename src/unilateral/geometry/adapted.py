"""The cells of T_H, the multiplier's partition of the boundary, on meshes refined where it is needed.

Places on the boundary are whole numbers: every edge of the first mesh is FIRST_EDGE_LENGTH long, and its
edges 0 and 1, 2 and 3, .. lie in one cell. So an edge of any later mesh is a dyadic interval. It asks for its
parent, which is twice as long; of nested parents the largest is a cell of T_H. Every edge that meets a cell
is then at most half of it, which keeps the pair of spaces stable. Where an edge is shorter than a quarter of
its cell, the cell's longest edges are halved, too; else edges in geometric progression would be one cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.mesh import MAX_ROUNDING_PER_H, Mesh, find_halved_edges, refine_triangles
from unilateral.geometry.partition import Partition

FIRST_EDGE_LENGTH = 2**44
"""The length of an edge of the first mesh; 2^19 such edges reach the limit of 64-bit integers. Rounding ends
the halving of an edge before its length is 1."""
MAX_CELL_EDGE_RATIO = 4
"""A cell may be at most this many times as long as its shortest edge."""
BULK_SHARE = 0.5
"""The shares of the marked triangles are to be at least this part of the sum of all shares."""


@dataclass(frozen=True, eq=False)
class AdaptedMesh:
    """A mesh whose boundary edge k lies between the whole numbers positions[k] and positions[k + 1]."""

    mesh: Mesh
    positions: Index

    @cached_property
    def cell(self) -> Index:
        """The cell of each boundary edge, (nb,)."""
        # The parent of an edge [a, a + l] is the dyadic interval of length 2 l that contains it
        length = 2 * np.diff(self.positions)
        start = self.positions[:-1] // length * length
        # Parents are nested or apart: in the order of their starts, the larger one first, each begins a new
        # cell unless it starts before an earlier one ends
        order = np.lexsort([-length, start])
        last_end = np.maximum.accumulate((start + length)[order])
        cell = np.empty(len(order), dtype=np.intp)
        cell[order] = np.cumsum(np.append(True, start[order][1:] >= last_end[:-1])) - 1
        return cell

    @cached_property
    def partition(self) -> Partition:
        """The partition T_H whose cells are the largest nested parents of the boundary edges."""
        first = np.flatnonzero(np.append(True, np.diff(self.cell) > 0))
        return Partition(self.mesh.polygon, self.mesh.s[np.append(first, -1)])

    @property
    def unbalanced_triangles(self) -> Index:
        """The triangles at boundary edges that are too long beside a shorter edge of the same cell."""
        length = np.diff(self.positions)
        cell_length = np.zeros(self.cell[-1] + 1, dtype=np.int64)
        np.add.at(cell_length, self.cell, length)
        shortest = cell_length.copy()
        np.minimum.at(shortest, self.cell, length)
        # No edge is over half its cell. If the shortest is too short, those of half the cell are too long
        is_half = 2 * length >= cell_length[self.cell]
        is_uneven = cell_length > MAX_CELL_EDGE_RATIO * shortest
        return self.mesh.boundary_triangles[is_half & is_uneven[self.cell]]


def start_adapted_mesh(mesh: Mesh) -> AdaptedMesh:
    """The first mesh: its boundary edges 0 and 1, 2 and 3, .., each pair of one length, make the cells."""
    return AdaptedMesh(mesh, FIRST_EDGE_LENGTH * np.arange(len(mesh.s), dtype=np.int64))


def mark_triangles(mesh: Mesh, shares: Array) -> Index:
    """The fewest triangles with BULK_SHARE of the sum of all shares (m,) (Doerfler, SINUM 33, 1996).

    Triangles whose edges are as short as rounding are left out. Raises InputError if none remains.
    """
    order = np.argsort(-shares, kind="stable")
    marked = order[: np.searchsorted(np.cumsum(shares[order]), BULK_SHARE * shares.sum()) + 1]
    # An edge of this length is rounded by MAX_ROUNDING_PER_H of it
    shortest = float(np.spacing(mesh.polygon.largest)) / MAX_ROUNDING_PER_H
    marked = marked[mesh.longest_edges[marked] > shortest]
    if marked.size == 0:
        raise InputError(
            f"the triangles of '{mesh.polygon.name}' from which most of the bound comes have edges of "
            f"{shortest:.2g}, as short as rounding allows; take a larger accuracy"
        )
    return marked


def halve_triangle_edges(adapted: AdaptedMesh, halvings: Index) -> AdaptedMesh:
    """The mesh with the edges of each triangle halved `halvings` (m,) times, and others as that needs."""
    remaining = halvings
    while (chosen := np.flatnonzero(remaining > 0)).size:
        adapted = _refine_once(adapted, chosen)
        # Children have one halving less to do than their parents; those cut for others' sake had none to do
        step = adapted.mesh.steps[-1]
        remaining = step.replace_values(remaining, remaining[step.parent] - 1)
    return refine_and_balance(adapted, adapted.unbalanced_triangles)


def refine_and_balance(adapted: AdaptedMesh, marked: Index) -> AdaptedMesh:
    """The mesh with the marked triangles cut in four, and others as conformity and balance need.

    Raises as `refine_triangles`.
    """
    while marked.size:
        adapted = _refine_once(adapted, marked)
        marked = adapted.unbalanced_triangles
    return adapted


def _refine_once(adapted: AdaptedMesh, marked: Index) -> AdaptedMesh:
    mesh = refine_triangles(adapted.mesh, marked)
    halved = find_halved_edges(mesh.boundary, adapted.mesh.n_nodes)
    middles = (adapted.positions[halved] + adapted.positions[halved + 1]) // 2
    return AdaptedMesh(mesh, np.insert(adapted.positions, halved + 1, middles))
