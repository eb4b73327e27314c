"""Where a reference mesh has its boundary nodes: graded to the cells' ends and to singular points."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.norms.oscillation import distance_to_other_sides

EDGES_PER_CELL = 8
HALVINGS_AT_SINGULARITY = 8
MIN_EDGE_DIAMETERS = 5e-8
"""The shortest edge, in diameters of the polygon: gmsh tells points apart that are 1e-8 apart."""
SNAP_DIAMETERS = 1e-6
"""A singular point at most this far from a cell's end, in diameters, counts as that end in the grading."""
MAX_REFERENCE_EDGE = 0.25
MAX_REFERENCE_EDGES = 8_000
"""On a large polygon edges may be as long as the perimeter divided by this number; the bounds stay valid."""


def grade_boundary_nodes(partition: Partition, singular: Iterable[float], edges_per_cell: int) -> Array:
    """Arc lengths of the reference mesh's boundary nodes, nested in T_H and in the singular points, (nb,).

    A cell has the given number of edges, at Chebyshev's points: shortest at its ends, where P0 functions
    jump. Singular points inside cut it in parts that share its edges; the edges at them are halved, as are
    those beside a shorter cell, those longer than MAX_REFERENCE_EDGE, and those that are long against shorter
    edges on a side near by. No edge is shorter than MIN_EDGE_DIAMETERS. The grading of a singular point that
    is as near to a cell's end as SNAP_DIAMETERS is to that end. Raises InputError if a cell is too short.
    """
    shortest = MIN_EDGE_DIAMETERS * partition.polygon.diameter
    _check_cell_lengths(partition, shortest)
    points = _snap_singular_points(partition, singular)
    cuts = np.union1d(partition.points, points)
    lengths = np.diff(cuts)
    counts = _count_edges(partition, cuts, points, edges_per_cell, shortest)
    # Chebyshev's points of each part between two cuts
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    share = 0.5 - 0.5 * np.cos(np.pi * index / np.repeat(counts, counts))
    nodes = [np.repeat(cuts[:-1], counts) + share * np.repeat(lengths, counts)]
    # the first and the last edge of each part, equally long; at singular points they are halved many times
    end_edges = (0.5 - 0.5 * np.cos(np.pi / counts)) * lengths
    halves = 0.5 ** np.arange(1, HALVINGS_AT_SINGULARITY + 1)
    for i, p in zip(np.searchsorted(cuts, points).tolist(), points, strict=True):
        after = end_edges[i % len(end_edges)] * halves
        before = end_edges[i - 1] * halves
        nodes += [p + after[after >= shortest], p - before[before >= shortest]]
    nodes += _grade_to_shorter_neighbours(cuts[:-1], end_edges)
    s = np.unique(np.concatenate(nodes) % partition.polygon.perimeter)
    return _halve_near_shorter_edges(partition.polygon, _halve_long_edges(partition.polygon, s))


def _count_edges(
    partition: Partition, cuts: Array, singular: Array, edges_per_cell: int, shortest: float
) -> Index:
    """The number of edges of each part between two cuts, (k,).

    A part has its share of the cell's edges, at least two between singular points, and so few that none is
    shorter than `shortest`.
    """
    lengths = np.diff(cuts)
    cell = np.searchsorted(partition.points, 0.5 * (cuts[1:] + cuts[:-1])) - 1
    # 1e-9: a part that is a whole number of edges long, up to rounding, has that number
    counts = np.ceil(lengths / (partition.lengths[cell] / edges_per_cell) - 1e-9).astype(int)
    both_ends = np.isin(cuts[:-1], singular) & np.isin(cuts[1:], singular)
    counts = np.maximum(counts, np.where(both_ends, 2, 1))
    # the first of n edges at Chebyshev's points of a part is (1 - cos(pi / n)) / 2 of it
    max_counts = np.floor(np.pi / np.arccos(1 - 2 * np.minimum(shortest / lengths, 1))).astype(int)
    return np.minimum(counts, max_counts)


def _check_cell_lengths(partition: Partition, shortest: float) -> None:
    i = int(np.argmin(partition.lengths))
    if partition.lengths[i] < shortest:
        raise InputError(
            f"partition: cell {i} has the length {partition.lengths[i]:.3g}; for bounds on the dual norm "
            f"it has to be {shortest:.3g} or more, {MIN_EDGE_DIAMETERS:g} of the polygon's diameter"
        )


def _snap_singular_points(partition: Partition, singular: Iterable[float]) -> Array:
    """The singular points' arc lengths, increasing; those within SNAP_DIAMETERS of a cell's end are moved."""
    perimeter = partition.polygon.perimeter
    s = np.array(sorted({point % perimeter for point in singular}))
    ends = partition.points[np.abs(s[:, None] - partition.points).argmin(axis=1)]
    snap = SNAP_DIAMETERS * partition.polygon.diameter
    snapped = np.unique(np.where(np.abs(s - ends) <= snap, ends, s) % perimeter)
    return snapped[np.diff(snapped, prepend=-np.inf) > snap]


def _halve_long_edges(polygon: Polygon, s: Array) -> Array:
    """The nodes s and more (nb,), inside edges too long for functions that decay with the distance 1."""
    limit = max(MAX_REFERENCE_EDGE, polygon.perimeter / MAX_REFERENCE_EDGES)
    ends = np.append(s, polygon.perimeter)
    while np.any(long := np.diff(ends) > limit):
        ends = np.union1d(ends, (0.5 * (ends[1:] + ends[:-1]))[long])
    return ends[:-1]


def _halve_near_shorter_edges(polygon: Polygon, s: Array) -> Array:
    """The nodes s and more (nb,): no edge is longer than twice one on another side plus the distance."""
    # else bounds are far apart where two sides are near each other, as in a wedge of one degree
    while True:
        ends = np.append(s, polygon.perimeter)
        lengths = np.diff(ends)
        middle = 0.5 * (ends[1:] + ends[:-1])
        side = polygon.sides_of(middle)
        points = polygon.at(side, middle - polygon.starts[side])
        # only edges nearer to another side than they are long can be too long
        candidates = np.flatnonzero(distance_to_other_sides(polygon, points, side) < lengths)
        distance = np.linalg.norm(points[candidates, None] - points, axis=2)
        distance[side[candidates, None] == side] = np.inf
        long = candidates[lengths[candidates] > (distance + 2 * lengths).min(axis=1) * (1 + 1e-9)]
        if not long.size:
            return s
        s = np.union1d(s, middle[long])


def _grade_to_shorter_neighbours(cuts: Array, end_edges: Array) -> list[Array]:
    """Nodes beside the cuts, where an edge is at least twice as long as the edge on the cut's other side."""
    # the longer edge is halved towards the cut, until the last half is less than twice the other edge
    before = np.roll(end_edges, 1)
    after = end_edges
    halvings = np.floor(np.abs(np.log2(after / before)) + 1e-9).astype(int)
    return [
        cuts[i] + (after[i] if after[i] > before[i] else -before[i]) * 0.5 ** np.arange(1, halvings[i] + 1)
        for i in np.flatnonzero(halvings)
    ]
