"""Where a solution is in contact: the cells with lambda_H > 0."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.geometry.partition import Partition


class ContactInterval(NamedTuple):
    """An interval of contact on a side, between two arc lengths from the side's own start.

    Its ends are at the places `first` and `last`.
    """

    side: int
    start: float
    end: float
    first: tuple[float, float]
    last: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Contact:
    """The contact set of lambda_H (m,), as far as the cells of the partition show it."""

    partition: Partition
    lambda_H: Array

    def __repr__(self) -> str:
        perimeter = self.partition.polygon.perimeter
        n = len(self.intervals)
        return f"Contact: length {self.length:.4g} of {perimeter:.4g}, {n} interval{'s' * (n != 1)}"

    @cached_property
    def intervals(self) -> list[ContactInterval]:
        """The longest runs of cells with lambda_H > 0 on one side, in the order of the boundary."""
        partition = self.partition
        (first_points, last_points) = self.partition.ends
        # the side of each cell, -1 without contact; an interval begins and ends where this changes
        contact_side = np.where(self.lambda_H > 0, partition.side, -1)
        first_cells = np.flatnonzero((contact_side >= 0) & (np.append(-1, contact_side[:-1]) != contact_side))
        last_cells = np.flatnonzero((contact_side >= 0) & (np.append(contact_side[1:], -1) != contact_side))
        side_start = partition.polygon.starts[partition.side]  # intervals count from there
        sides = partition.side.tolist()
        start = partition.points[:-1] - side_start
        end = partition.points[1:] - side_start
        return [
            ContactInterval(
                side=sides[i],
                start=float(start[i]),
                end=float(end[k]),
                first=_as_pair(first_points[i]),
                last=_as_pair(last_points[k]),
            )
            for i, k in zip(first_cells, last_cells, strict=True)
        ]

    @cached_property
    def lengths(self) -> Array:
        """Lengths (n,) of the contact on the n sides."""
        partition = self.partition
        contact_lengths = np.where(self.lambda_H > 0, partition.lengths, 0.0)
        return np.bincount(partition.side, contact_lengths, partition.polygon.n_sides).astype(np.float64)

    @property
    def length(self) -> float:
        """Length of the contact on all sides together."""
        return float(self.lengths.sum())

    @property
    def full(self) -> bool:
        """Whether the whole boundary is in contact."""
        return bool((self.lambda_H > 0).all())


def _as_pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])
