"""Where a solution is in contact: the cells with lambda_H > 0, and what is proved of the exact solution."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.certain_contact import CertainArc, Verdict, find_certain_contact
from unilateral.geometry.partition import Partition
from unilateral.solution.bounds import explain_memory_shortage, has_consistent_bounds

if TYPE_CHECKING:
    from unilateral.solution.solution import Solution

MAX_PRINTED_ARCS = 4
"""Of what is proved of a side at most so many arcs with each verdict are printed."""


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
    """The contact set of lambda_H (m,), as far as cells of the partition show it: not guaranteed.

    `prove_arcs` finds what is `certain`.

    >>> import unilateral as ul
    >>> ul.solve("clamped", h=1 / 16, H=1 / 8).contact.certain[2]
    CertainArc(side=1, start=0.125, end=0.875, verdict=<Verdict.FREE: 'does not touch'>)
    """

    partition: Partition
    lambda_H: Array
    prove_arcs: Callable[[], list[CertainArc]] = list

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

    @cached_property
    def certain(self) -> list[CertainArc]:
        """Arcs that cover the sides with contact conditions, with what is guaranteed of the exact solution.

        On an arc that "touches" u = g somewhere, on one that "does not touch" u > g everywhere.
        """
        return self.prove_arcs()

    @cached_property
    def certain_cells(self) -> Array:
        """1 on cells (m,) that meet an arc that touches for certain, -1 in arcs that do not touch, else 0."""
        partition = self.partition
        values = np.zeros(partition.n_cells)
        for arc in self.certain:
            start, end = partition.polygon.starts[arc.side] + np.array([arc.start, arc.end])
            # an arc that touches may be longer than a cell
            if arc.verdict is Verdict.TOUCHES:
                values[(partition.points[1:] > start) & (partition.points[:-1] < end)] = 1
            if arc.verdict is Verdict.FREE:
                values[(partition.points[1:] <= end) & (partition.points[:-1] >= start)] = -1
        return values

    @property
    def full(self) -> bool:
        """Whether the whole boundary is in contact."""
        return bool((self.lambda_H > 0).all())


def _as_pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def prove_contact(solution: Solution) -> list[CertainArc]:
    """Arcs of the sides with contact, and what is proved of them by the smallest bounds that are computed."""
    bounded = solution.bounded
    if explain_memory_shortage(solution, sharp=False) or not has_consistent_bounds(solution):
        polygon = solution.polygon
        sides = np.flatnonzero(bounded.form.has_multiplier(np.arange(polygon.n_sides))).tolist()
        return [CertainArc(side, 0.0, float(polygon.lengths[side]), Verdict.UNDECIDED) for side in sides]
    bound = bounded.local_bound
    assert bound is not None  # the data are enclosed
    assert bounded.data is not None
    sharp = bounded.sharp_bound if bounded.has_bound(sharp=True) else None
    if sharp:
        bound = replace(bound, u=min(bound.u, sharp.u), lambda_=min(bound.lambda_, sharp.lambda_))
    return find_certain_contact(
        bounded.data,
        bounded.partition,
        bounded.u_h,
        bounded.lambda_H,
        bounded.form,
        bound,
        idle_sides=solution.problem.idle_sides(),
    )


def describe_certain_arcs(arcs: Sequence[CertainArc]) -> str:
    """Words on what is proved of one side: verdicts with arcs, and the length that is not decided."""
    texts = []
    for verdict in (Verdict.TOUCHES, Verdict.FREE):
        # arcs that touch lie in a row: there is contact in each of them
        rows = [[*row] for found, row in groupby(arcs, key=lambda arc: arc.verdict) if found is verdict]
        places = [
            f"{row[0].start:.4g} to {row[-1].end:.4g}" + f" in each of {len(row)} parts" * (len(row) > 1)
            for row in rows[:MAX_PRINTED_ARCS]
        ]
        omitted = f" and {len(rows) - MAX_PRINTED_ARCS} more" if len(rows) > MAX_PRINTED_ARCS else ""
        if places:
            within = "within " if verdict is Verdict.TOUCHES else ""
            texts.append(f"{verdict} {within}{', '.join(places)}{omitted}")
    undecided = sum(arc.end - arc.start for arc in arcs if arc.verdict is Verdict.UNDECIDED)
    texts += [f"not decided on {undecided:.4g} of {arcs[-1].end:.4g}"] if undecided else []
    return "; ".join(texts)
