"""g and q on the sides of a polygon, enclosed: piecewise polynomials, and how far g and q are from them.

This is done once for a problem, whatever the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas.taylor import EPS
from unilateral.geometry.curves import Singular
from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import (
    ORDER,
    PLACES,
    SHORTEST,
    SIGNS,
    IntervalPieces,
    Piecewise,
    SideModel,
    in_pieces,
    on_intervals,
)

CUT = (3 - 5**0.5) / 2
"""Where q is given a side is first cut at this part of its length.

Then no jump that is written as a fraction is in the middle of a piece. There it would be taken for rounding,
which no shorter piece takes away.
"""
JUMP = 1e-12
"""What is given on two sides may differ at their vertex by this part of the larger of the two numbers there.

That is for users who round: `data_checks` refuses what differs by more, beyond the doubt of both, and
`bounds.constraint` takes away what differs by less.
"""
HIDDEN = 2.0**-26
"""Rounding hides whether data fit together at a vertex if it leaves fewer than half of the digits there.

They are those of the larger one of the two sides, for a number itself may be 0.
"""
TINY = 1e-140
"""Data of this size are taken for 0, see `data_checks.SMALLEST`."""
WIDE = 4 * PLACES
"""For q no piece is cut in parts shorter than half of this many units in the last place of the perimeter."""


class EdgePolynomials(NamedTuple):
    """The polynomials of an `Obstacle` on edges, at Q Gauss points of K intervals and at the edges' ends.

    The intervals lie on the edges `edge` (K,), and have that `half` length (K,). At the arc lengths s (K, Q)
    the polynomials have the values `value` and the derivatives `slope` (K, Q); the rule's `weights` (Q,)
    belong to [-1, 1]. `doubt`, `upper`, `steep` and `kinks` (K,) are those of the obstacle, the last within
    `reach` of the ends of pieces.

    At the start, the end and the midpoint of all edges the polynomials have the values `ends` (nb, 3), from
    inside the edge. At an edge's start they may differ by `allowed_jumps` (nb,) where data fit together: on
    either of two that meet the polynomial is within its doubt of g. None is allowed, not even 0, where it is
    `hidden`.
    """

    edge: Index
    s: Array
    half: Array
    weights: Array
    value: Array
    slope: Array
    doubt: Array
    upper: Array
    steep: Array
    kinks: Array
    reach: float
    ends: Array
    allowed_jumps: Array


@dataclass(frozen=True, eq=False)
class Obstacle(Piecewise):
    """g, -inf on sides that are free. Where two pieces meet on a side their polynomials agree.

    On clamped sides it is the given u, the derivative of which, by the arc length, is within `steep` (k,) of
    the polynomials'. Near a piece's ends, as far as places may be rounded, it may be that of the next piece,
    and is within `kinks` (k,). Both are 0 on all other sides.

    At the vertices g is within `end_doubts` (2, n) of the `ends` (2, n): on the side that ends there, then on
    the one that starts there. Both are 0 on sides that are free.
    """

    steep: Array
    kinks: Array
    ends: Array
    end_doubts: Array

    def means(self, points: Array) -> Array:
        """(m,) the polynomials' means between arc lengths `points` (m + 1,), from 0 to the perimeter."""
        samples = self.sample(points, ORDER // 2 + 1)
        cell = np.searchsorted(points, samples.middle) - 1
        integrals = samples.half * (samples.value @ samples.weights)
        return np.asarray(np.bincount(cell, integrals, len(points) - 1) / np.diff(points))

    @property
    def rounded_jumps(self) -> Array:
        """(n,) by how much `ends` may differ at the vertices, beyond their doubts, where users rounded."""
        return np.asarray(JUMP * np.abs(self.ends).max(axis=0))

    @property
    def hidden(self) -> Mask:
        """(n,) whether rounding hides at a vertex whether the two `ends` fit together.

        So it is with steep data, as a place is rounded: u may jump there for all that is known.
        """
        sizes = np.full(self.polygon.n_sides, TINY)
        np.maximum.at(sizes, self.side, np.abs(self.c).sum(axis=0))
        doubt = self.end_doubts.sum(axis=0)
        apart = np.abs(np.diff(self.ends, axis=0)[0]) > self.rounded_jumps + doubt
        return ~apart & ~(doubt <= HIDDEN * np.maximum(sizes, np.roll(sizes, 1)))

    def on_edges(self, s: Array, side: Index, chosen: Mask, parts: int) -> EdgePolynomials:
        """The polynomials on the edges between arc lengths s (nb + 1,) of the perimeter, on the sides (nb,).

        The `chosen` edges (nb,) are cut into so many equal `parts`, and where pieces end.
        """
        inner = s[:-1, None] + np.diff(s)[:, None] * np.arange(parts) / parts
        samples = self.sample(np.append(inner.ravel(), s[-1]))
        edge = np.searchsorted(s, samples.middle) - 1
        wanted = chosen[edge]
        piece = samples.piece[wanted]

        # At the ends of an edge the pieces count that lie on it
        start = self.on(s[:-1])
        end = np.clip(np.searchsorted(self.points, s[1:]) - 1, 0, len(self.side) - 1)
        places = np.stack([s[:-1], s[1:], 0.5 * (s[1:] + s[:-1])], axis=1)
        ends = self.at(np.column_stack([start, end, self.on(places[:, 2])]), places)[0]

        # If `data_checks` accepts them, the two g at a vertex differ by at most `rounded_jumps` and twice the
        # `end_doubts`: their values are known up to these, and compared up to these
        allowed_jumps = self.doubt[start] + np.roll(self.doubt[end], 1)
        vertices = np.searchsorted(side, np.arange(self.polygon.n_sides))
        allowed_jumps[vertices] += self.rounded_jumps + 2 * self.end_doubts.sum(axis=0)
        allowed_jumps[vertices[self.hidden]] = -np.inf
        return EdgePolynomials(
            edge=edge[wanted],
            s=samples.s[wanted],
            half=samples.half[wanted],
            weights=samples.weights,
            value=samples.value[wanted],
            slope=samples.slope[wanted],
            doubt=self.doubt[piece],
            upper=self.upper[piece],
            steep=self.steep[piece],
            kinks=self.kinks[piece],
            reach=PLACES * float(np.spacing(self.points[-1])),
            ends=ends,
            allowed_jumps=allowed_jumps,
        )


def enclose_obstacle(
    polygon: Polygon,
    model: SideModel,
    free: Sequence[int] = (),
    least: float = -np.inf,
    cuts: Iterable[Singular] = (),
    clamped: Sequence[int] = (),
    slope: SideModel | None = None,
) -> Obstacle:
    """g on the sides that are not `free`, or the given u on those that are `clamped`.

    Below `least`, which u exceeds, it need not be known as well. It takes fewer pieces if these begin and end
    at the points where g is known not to be smooth. Each piece but a side's last is changed linearly to end
    where the next one begins. `slope` is the derivative of u on clamped sides by the arc length in side
    lengths.
    """
    pieces = in_pieces(polygon, model, free, least, cuts)
    side, _, _, c, rad, lower, upper = pieces
    gap = np.append((SIGNS @ c)[1:] - c.sum(axis=0)[:-1], 0.0)
    gap[np.append(side[1:] != side[:-1], True)] = 0.0
    c[:2] += 0.5 * gap
    points = pieces.points(polygon)
    rounding = pieces.rounding(points)
    doubt = _of_neighbours(rad + np.abs(gap) + rounding, side)
    bounds = lower - rounding, _of_neighbours(upper, side) + rounding
    steep, kinks = _steep(polygon, pieces, points, clamped, slope)
    ends, end_doubts = _at_vertices(polygon, model, free, side, c, doubt)
    return Obstacle(polygon, points, side, c, doubt, *bounds, steep, kinks, ends, end_doubts)


def _at_vertices(
    polygon: Polygon, model: SideModel, free: Sequence[int], side: Index, c: Array, doubt: Array
) -> tuple[Array, Array]:
    """(2, n), (2, n) the `ends` and `end_doubts` of an `Obstacle`.

    g is enclosed at the vertex itself, however little is known of it on the pieces beside the vertex. If no
    enclosure is known at the vertex, as next to a singularity, that of the piece there is taken.
    """
    n = polygon.n_sides
    ends, doubts = np.zeros((2, 2, n))
    with_g = np.setdiff1d(np.arange(n), free)
    for row, t in ((0, 1.0), (1, 0.0)) if with_g.size else ():
        place = np.full(len(with_g), t)
        exact = on_intervals(model, with_g, place, place)
        piece = np.searchsorted(side, with_g, side="right") - 1 if t else np.searchsorted(side, with_g)
        value = c[:, piece].sum(axis=0) if t else SIGNS @ c[:, piece]
        known = np.isfinite(exact.rad)
        vertex = (with_g + int(t)) % n
        ends[row, vertex] = np.where(known, exact.c[0], value)
        doubts[row, vertex] = np.where(known, exact.rad, doubt[piece])
    return ends, doubts


def _steep(
    polygon: Polygon, of: IntervalPieces, points: Array, clamped: Sequence[int], slope: SideModel | None
) -> Array:
    """(2, k) how far the derivatives of the polynomials may be from that of u on `clamped` sides.

    The second row is for places near the ends of a piece, see `Obstacle.kinks`.
    """
    found = np.zeros((2, len(of.side)))
    at = np.flatnonzero(np.isin(of.side, clamped))
    if not at.size or slope is None:
        return found
    exact = on_intervals(slope, of.side[at], of.start[at], of.end[at])
    k = np.arange(ORDER + 1.0)
    half = 0.5 * np.diff(points)[at]
    length = polygon.lengths[of.side[at]]
    rises = np.roll(k[:, None] * of.c[:, at], -1, axis=0) / half
    moved = 2 * PLACES * np.spacing(points[-1]) / half
    rounding = np.abs(rises).sum(axis=0) * 16 * EPS + k @ np.abs(rises) * moved
    steep = np.abs(exact.c / length - rises).sum(axis=0) + exact.rad / length + rounding
    jumps = np.abs((SIGNS @ rises)[1:] - rises.sum(axis=0)[:-1]) + steep[1:] + steep[:-1]
    jumps[np.diff(of.side[at]) != 0] = 0.0
    found[:, at] = steep, np.maximum(np.append(jumps, 0.0), np.append(0.0, jumps))
    return found


def _of_neighbours(values: Array, side: Index) -> Array:
    """(k,) the largest value on a piece and those beside it on its side, where a rounded place may lie."""
    largest = values.copy()
    same = side[1:] == side[:-1]
    for one, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        largest[one] = np.where(same, np.maximum(largest[one], values[other]), largest[one])
    return largest


@dataclass(frozen=True, eq=False)
class Flux(Piecewise):
    """q on the pieces where it is `given` (k,), and 0 on the others. It may jump.

    Near a jump q is known less well, as far as a short piece and the rounding of places reach: within `reach`
    of points[i] it differs from the polynomials on both sides by at most `jumps` (k + 1,)[i].
    """

    given: Mask
    jumps: Array
    reach: float

    @property
    def least(self) -> float:
        """A lower bound on q on the sides on which it is given; infinite if there are none."""
        return float(self.lower[self.given].min(initial=np.inf))


def enclose_flux(
    polygon: Polygon, model: SideModel, on: Sequence[int], cuts: Iterable[Singular] = ()
) -> Flux:
    """q, given on the sides `on`, and 0 elsewhere; `cuts` as in `enclose_obstacle`."""
    without = np.setdiff1d(np.arange(polygon.n_sides), on).tolist()
    unit = float(np.spacing(polygon.perimeter))
    shortest = np.maximum(SHORTEST, WIDE * unit / polygon.lengths)
    first = [*(Singular(i, CUT, 1) for i in on), *cuts]
    pieces = in_pieces(polygon, model, without, cuts=first, shortest=shortest)
    points = pieces.points(polygon)
    doubt = pieces.rad + pieces.rounding(points)
    side, _, _, c, _, lower, upper = pieces
    ends = np.abs((SIGNS @ c)[1:] - c.sum(axis=0)[:-1]) + doubt[1:] + doubt[:-1]
    inner = np.where(side[1:] == side[:-1], ends, 0.0)  # the place of a vertex is exact
    given = np.isin(side, on)
    jumps = np.concatenate([[0.0], inner, [0.0]])
    return Flux(polygon, points, side, c, doubt, lower, upper, given, jumps, PLACES * unit)
