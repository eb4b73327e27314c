"""How finely a mesh resolves a partition: the local rule, and the constants of Theorem 5 of paper.md.

Theorem 5: if every cell i has a boundary node at a distance of at least delta H_i from both its ends, and
neighbouring cells differ by a factor of at most alpha_1, both inequalities of (3.4) hold with constants that
depend on delta > 0, alpha_1, the domain and the smallest angle only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.geometry.plane import cross

CELL_ROUND_OFF = 1e-9
"""A node that is nearer to an end of a cell than this share of the cell counts as that end."""


class Rule(NamedTuple):
    """The least H_i over the longest edge that meets cell i, and the least angle in degrees, of a rule."""

    cell_over_edge: float
    smallest_angle: float


RULE = Rule(cell_over_edge=2, smallest_angle=20)
"""A rule of thumb. With it delta is at least 1/4; the claim S.local says what beta the study met."""


class Resolution(NamedTuple):
    """How finely a mesh resolves a partition; of each measure, the smallest value over the cells T_i.

    `edges_per_cell` counts boundary edges, parts as fractions; `cell_over_edge` is H_i over the longest edge
    that meets the inside of T_i; `nodes_per_cell` counts the mesh nodes inside T_i; `smallest_angle` is that
    of the triangles at the boundary, in degrees. `delta` and `alpha_1` are the constants of Theorem 5, delta
    at most 1/2, and 0 where a cell has no node inside.
    """

    edges_per_cell: float
    cell_over_edge: float
    nodes_per_cell: int
    smallest_angle: float
    delta: float
    alpha_1: float


class CellResolution(NamedTuple):
    """The same measures of every cell, (m,) each."""

    edges: Array
    cell_over_edge: Array
    nodes: Array
    deltas: Array


def resolution(mesh: Mesh, partition: Partition) -> Resolution:
    """The measures of h/H that the cells of T_H see, the smallest of each."""
    cells = cell_resolution(mesh, partition)
    return Resolution(
        float(cells.edges.min()),
        float(cells.cell_over_edge.min()),
        int(cells.nodes.min()),
        float(boundary_angles(mesh)[1].min()),
        float(cells.deltas.min()),
        partition.alpha_1,
    )


def cell_resolution(mesh: Mesh, partition: Partition) -> CellResolution:
    """The measures of each cell."""
    points, cell, edge = overlay(partition.points, mesh.s)
    lengths = np.diff(mesh.s)
    # parts of edges count as fractions; between k + 1 parts of a cell lie k nodes
    edges = np.bincount(cell, np.diff(points) / lengths[edge], partition.n_cells)
    longest = np.zeros(partition.n_cells)
    np.maximum.at(longest, cell, lengths[edge])
    inside = np.bincount(cell, minlength=partition.n_cells) - 1
    deltas = innermost_nodes(mesh.s, partition)[1]
    return CellResolution(edges.astype(float), partition.lengths / longest, inside.astype(float), deltas)


def innermost_nodes(s: Array, partition: Partition) -> tuple[Array, Array]:
    """The mesh node farthest from the ends of each cell, and that distance over H_i, (m,).

    `s` (nb + 1,) are the nodes' arc lengths, the perimeter last. For a cell without a node inside, up to
    round-off, they are its start and 0.
    """
    nodes = s[:-1]
    ends = partition.points
    cell = np.searchsorted(ends, nodes, side="right") - 1
    share = np.minimum(nodes - ends[cell], ends[cell + 1] - nodes) / partition.lengths[cell]
    # in the order of their shares: the last node written into a cell is the innermost one
    order = np.argsort(share, kind="stable")
    order = order[share[order] > CELL_ROUND_OFF]
    chosen = ends[:-1].copy()
    deltas = np.zeros(partition.n_cells)
    chosen[cell[order]] = nodes[order]
    deltas[cell[order]] = share[order]
    return chosen, deltas


def boundary_angles(mesh: Mesh) -> tuple[Index, Array]:
    """The triangles with two or three nodes on the boundary, and their smallest angles in degrees, (k,)."""
    triangles = np.flatnonzero(np.isin(mesh.triangles, mesh.boundary).sum(axis=1) >= 2)
    a, b, c = np.moveaxis(mesh.points[mesh.triangles[triangles]], 1, 0)
    sides = [b - a, c - b, a - c]
    # the angle between one side and the next, turned around
    angles = [
        np.arctan2(np.abs(cross(p, q)), -np.sum(p * q, axis=1))
        for p, q in zip(sides, [*sides[1:], sides[0]], strict=True)
    ]
    return triangles, np.degrees(np.min(angles, axis=0))


def is_fine_enough(cell_over_edge: Array) -> Mask:
    """Whether the rule allows these values of H_i over the longest edge, up to round-off."""
    return np.asarray(cell_over_edge >= RULE.cell_over_edge * (1 - CELL_ROUND_OFF))


def is_wide_enough(angles: Array) -> Mask:
    """Whether the rule allows these angles, in degrees."""
    return np.asarray(angles >= RULE.smallest_angle)
