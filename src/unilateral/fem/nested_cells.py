"""The cells of T_H on nested levels, where every point of T_H is a node of the finest one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.hierarchy import Hierarchy
from unilateral.geometry.partition import VERTEX_TOLERANCE, Partition

MIN_EDGES_PER_CELL = 2
"""A cell has at least this many edges: a node then lies inside it, and the rows of B are independent."""


@dataclass(frozen=True, eq=False)
class LevelCells:
    """The m cells of a level on which there are multipliers, each a union of boundary edges.

    `B` (m, n): the integrals of the hats over the cells, 0 at clamped nodes; `inner_node` (m,): a node inside
    each cell; `parent` (m,): the cell of the level before that contains it, None if that level has no cells.
    """

    B: sp.csr_array
    inner_node: Index
    parent: Index | None

    @cached_property
    def lengths(self) -> Array:
        """The lengths H_i of the cells; shape (m,)."""
        return np.asarray(self.B.sum(axis=1))

    def nodes(self, selection: Mask) -> Index:
        """The nodes of the chosen cells (m,), increasing."""
        return np.unique(self.B[selection].indices)


def nested_cells(hierarchy: Hierarchy, partition: Partition) -> list[LevelCells] | None:
    """The cells of the last levels, for as many levels as have cells, on sides where there are multipliers.

    A level's cells are the smallest unions of finer ones with at least two of its edges; where refinement was
    not uniform only the last level has cells. None where a point of the partition is no node, or a cell has
    one edge only.
    """
    s = hierarchy.s
    # cell i reaches from boundary node ends[i, 0] to ends[i, 1], the nearest ones to its end points
    chosen = hierarchy.form.has_multiplier(partition.side)
    place = np.searchsorted(0.5 * (s[1:] + s[:-1]), partition.points)
    ends = np.column_stack([place[:-1], place[1:]])[chosen]
    side = partition.side[chosen]
    # every point of T_H is a node, up to the rounding of arc lengths
    apart = float(np.max(np.abs(s[place] - partition.points)))
    if apart > VERTEX_TOLERANCE * partition.polygon.perimeter or np.any(np.diff(ends) < MIN_EDGES_PER_CELL):
        return None
    levels: list[LevelCells] = []
    while True:
        first = _group_cells(ends, side) if hierarchy.coarser else None
        parent = None if first is None else np.searchsorted(first, np.arange(len(ends)), side="right") - 1
        B = _integrate_hats(hierarchy, ends)
        levels.insert(0, LevelCells(B, _choose_inner_nodes(hierarchy, ends), parent))
        if first is None or hierarchy.coarser is None:
            return levels
        # a union reaches from the first of its cells to the last one; the level before has every second node
        last = np.append(first, len(ends))[1:] - 1
        ends = np.column_stack([ends[first, 0], ends[last, 1]]) // 2
        side = side[first]
        hierarchy = hierarchy.coarser


def _group_cells(ends: Index, side: Index) -> Index | None:
    """The number of the first cell of each union; None if a side is too short for one.

    A union is a cell of the level before. `ends` (m, 2) are places along the boundary, as in `nested_cells`,
    and `side` (m,) are the cells' sides. Every second place is a node of the level before.
    """
    firsts: list[int] = []
    for number in np.unique(side):
        first, *candidates = np.flatnonzero(side == number).tolist()
        begins = [first]
        for i in candidates:
            # a union begins at a node of the level before, where its edges are two of this level
            if ends[i, 0] % 2 == 0 and ends[i, 0] - ends[begins[-1], 0] >= 2 * MIN_EDGES_PER_CELL:
                begins.append(i)
        # what is left of the side goes to the union before, if it is too short for one of its own
        if ends[side == number].max() - ends[begins[-1], 0] < 2 * MIN_EDGES_PER_CELL:
            begins.pop()
        if not begins:
            return None
        firsts += begins
    return np.array(firsts, dtype=np.intp)


def _choose_inner_nodes(hierarchy: Hierarchy, ends: Index) -> Index:
    """The node inside each cell whose hat has the largest integral: the longest edges; shape (m,).

    `multigrid_bounds.shift_to_feasible` closes the gap on the cell by this hat, times the gap over that
    integral. A cell has two edges at least. `ends` (m, 2) are places along the boundary.
    """
    # nodes inside cells, sorted by cell and then by the length of their two edges, the longest first
    length = np.diff(hierarchy.s)
    cell = np.repeat(np.arange(len(ends)), ends[:, 1] - ends[:, 0] - 1)
    node = np.concatenate([np.arange(begin + 1, end) for begin, end in ends] or [cell])
    order = np.lexsort([node, -(length[node] + length[node - 1]), cell])
    return hierarchy.boundary[node[order[np.searchsorted(cell, np.arange(len(ends)))]]].astype(np.intp)


def _integrate_hats(hierarchy: Hierarchy, ends: Index) -> sp.csr_array:
    """B (m, n): half of each edge's length, for both of its ends unless these are clamped."""
    count = ends[:, 1] - ends[:, 0]
    # the edges of all cells, one cell after another
    cell = np.repeat(np.arange(len(ends)), count)
    edge = np.arange(len(cell)) + (ends[:, 0] - np.cumsum(count) + count)[cell]
    half = 0.5 * np.diff(hierarchy.s)[edge]
    nodes = np.concatenate([hierarchy.boundary[edge], np.roll(hierarchy.boundary, -1)[edge]])
    entries = (np.where(hierarchy.clamped_nodes[nodes], 0.0, np.tile(half, 2)), (np.tile(cell, 2), nodes))
    return sp.coo_array(entries, shape=(len(ends), hierarchy.n)).tocsr()
