"""T_H: partitions of the boundary into the cells of the multiplier, independent of the mesh (section 2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, Mask, read_floats
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon

VERTEX_TOLERANCE = 1e-12
"""Arc lengths that differ by this part of the perimeter are the same place, for they are rounded like it. In
`balance_cells` it is the part of a cell's length that rounding may add to it."""


@dataclass(frozen=True, eq=False)
class Partition:
    """The paper's T_H: cell i is the part of the boundary between points[i] and points[i + 1].

    `points` (m + 1,) are arc lengths, strictly increasing from 0 to the perimeter; the polygon's vertices
    (`polygon.starts`) are among them, exactly. Raises InputError if they are not.
    """

    polygon: Polygon
    points: Array

    def __post_init__(self) -> None:
        points = read_floats(self.points, "partition")
        points.setflags(write=False)
        object.__setattr__(self, "points", points)
        _check_arc_lengths(self.polygon, points)

    def __repr__(self) -> str:
        return f"Partition of '{self.polygon.name}': {self.n_cells} cells, H = {self.H:.4g}"

    @property
    def n_cells(self) -> int:
        """The number of cells."""
        return len(self.points) - 1

    @cached_property
    def lengths(self) -> Array:
        """The lengths H_i of the cells, (m,)."""
        return np.diff(self.points)

    @cached_property
    def side(self) -> Index:
        """The side of the polygon on which each cell lies, (m,)."""
        return self.polygon.sides_of(self.points[:-1])

    @cached_property
    def ends(self) -> tuple[Array, Array]:
        """The points at which the cells start, and those at which they end, (m, 2) each."""
        starts = self.polygon.starts[self.side]
        first = self.polygon.at(self.side, self.points[:-1] - starts)
        last = self.polygon.at(self.side, self.points[1:] - starts)
        return first, last

    def means(self, values: Array, points: Array) -> Array:
        """Means (k,) between arc lengths (k + 1,) of the function that has the values (m,) on the cells."""
        # The integral from 0 to s is linear on each cell, so that interpolation is exact
        integral = np.append(0.0, np.cumsum(self.lengths * values))
        return np.diff(np.interp(points, self.points, integral)) / np.diff(points)

    def cells_of(self, finer: Array) -> Index:
        """The cell that contains each interval between the points `finer` (k + 1,) of a partition, (k,).

        Raises InputError if a point of this one is not, up to round-off, among them.
        """
        distance = np.abs(finer[None] - self.points[:, None]).min(axis=1)
        missed = np.flatnonzero(distance > VERTEX_TOLERANCE * self.polygon.perimeter)
        if missed.size:
            raise InputError(
                f"partition: point {missed[0]} ({self.points[missed[0]]:.17g}) is not among the points of "
                "the finer partition; it has to be nested in it"
            )
        return np.searchsorted(self.points, 0.5 * (finer[1:] + finer[:-1])) - 1

    def has_inside(self, s: Array) -> Mask:
        """Whether a cell has an arc length of s inside and not, up to round-off, at an end, (m,)."""
        # the perimeter, which is in no cell, is at an end
        cell = np.searchsorted(self.points, s, side="right") - 1
        end_distance = np.abs(s[:, None] - self.points).min(axis=1)
        has_one = np.zeros(self.n_cells, dtype=bool)
        has_one[cell[end_distance > VERTEX_TOLERANCE * self.polygon.perimeter]] = True
        return has_one

    @property
    def H(self) -> float:
        """The length of the longest cell."""
        return float(self.lengths.max())

    @property
    def H_over_Hi_max(self) -> float:
        """The largest H / H_i, which the paper bounds by alpha_0."""
        return self.H / float(self.lengths.min())

    @property
    def alpha_1(self) -> float:
        """The largest ratio of the lengths of two neighbouring cells, around vertices, too."""
        ratio = self.lengths / np.roll(self.lengths, 1)
        return float(np.maximum(ratio, 1 / ratio).max())


def overlay(first: Array, second: Array) -> tuple[Array, Index, Index]:
    """The arc lengths (k + 1,) of two divisions together, and which interval of each contains these, (k,)."""
    points = np.union1d(first, second)
    first_index = np.searchsorted(first, points[:-1], side="right") - 1
    second_index = np.searchsorted(second, points[:-1], side="right") - 1
    return points, first_index, second_index


def make_uniform_partition(polygon: Polygon, H: float) -> Partition:
    """Every side cut into equal cells, as few as keep them no longer than H."""
    return Partition(polygon, polygon.divided(polygon.counts(H)))


def from_points(polygon: Polygon, points: ArrayLike) -> Partition:
    """The partition with the given arc lengths (m + 1,); those of a vertex up to round-off are made exact.

    Raises InputError if the points miss a vertex, do not increase strictly, or leave [0, perimeter].
    """
    snapped = read_floats(points, "partition")
    if snapped.size:
        # A vertex replaces the point that is nearest to it, if that is the same place
        distance = np.abs(snapped[None] - polygon.starts[:, None])
        vertex = np.flatnonzero(distance.min(axis=1) <= VERTEX_TOLERANCE * polygon.perimeter)
        snapped[distance.argmin(axis=1)[vertex]] = polygon.starts[vertex]
    return Partition(polygon, snapped)


def make_shifted_partition(polygon: Polygon, H: float, fraction: float) -> Partition:
    """The uniform partition with the points inside each side moved forward by `fraction` of a cell.

    The vertices stay: the first cell of a side grows and its last shrinks. Raises InputError for a fraction
    outside [0, 1).
    """
    if not 0 <= fraction < 1:
        raise InputError(f"partition: the shift {fraction:g} is not in [0, 1), a fraction of a cell")
    cells = make_uniform_partition(polygon, H)
    inside = ~np.isin(cells.points[:-1], polygon.starts)
    shifted = cells.points[:-1] + fraction * np.where(inside, cells.lengths, 0.0)
    return Partition(polygon, np.append(shifted, polygon.perimeter))


def common_refinement(partitions: Sequence[Partition]) -> Partition:
    """The coarsest partition that refines all given ones; points that differ by round-off count as one."""
    polygon = partitions[0].polygon
    points = np.unique(np.concatenate([polygon.starts, *(partition.points for partition in partitions)]))
    # The first one of points at one place stays; if a vertex is there, from_points moves it to that
    first = np.diff(points, prepend=-np.inf) > VERTEX_TOLERANCE * polygon.perimeter
    return from_points(polygon, points[first])


def divide_cells(partition: Partition, count: int = 2) -> Partition:
    """The partition with every cell cut into that many equal ones."""
    positions = np.arange(count * partition.n_cells + 1) / count
    points = np.interp(positions, np.arange(partition.n_cells + 1), partition.points)
    return Partition(partition.polygon, points)


def balance_cells(partition: Partition) -> Partition:
    """The partition with cells halved until none is over twice as long as a neighbour, but for round-off."""
    while True:
        s = partition.points
        lengths = partition.lengths
        # A halved cell may be too long still, or make a neighbour so
        beside = np.minimum(np.roll(lengths, 1), np.roll(lengths, -1))
        long = lengths > (2 + VERTEX_TOLERANCE) * beside
        if not long.any():
            return partition
        middle = 0.5 * (s[:-1] + s[1:])
        partition = Partition(partition.polygon, np.sort(np.append(s, middle[long])))


def _check_arc_lengths(polygon: Polygon, points: Array) -> None:
    inside = (points >= 0) & (points <= polygon.perimeter)
    wrong = np.flatnonzero(~(inside & (np.diff(points, prepend=-np.inf) > 0)))
    if wrong.size:
        first = wrong[0]
        raise InputError(
            f"partition: point {first} ({points[first]:.17g}) is out of order; arc lengths have to increase "
            f"strictly from 0 to {polygon.perimeter:.17g}"
        )
    missed = np.flatnonzero(~np.isin(polygon.starts, points))
    if missed.size:
        first = missed[0]
        raise InputError(
            f"partition: vertex {first % polygon.n_sides} of polygon '{polygon.name}', "
            f"at arc length {polygon.starts[first]:.17g}, is missing from the points; "
            "every vertex has to be one of them"
        )
