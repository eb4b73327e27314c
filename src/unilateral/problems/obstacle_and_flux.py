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
from unilateral.geometry.curves import SingularPoint
from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import (
    ARC_LENGTH_ERROR_ULPS,
    MIN_PIECE_PER_SIDE,
    PIECE_DEGREE,
    POWERS_AT_MINUS_ONE,
    IntervalPieces,
    Piecewise,
    SideModel,
    enclose_in_pieces,
    enclose_on_intervals,
)

FIRST_CUT = (3 - 5**0.5) / 2
"""Where q is given a side is first cut at this part of its length.

Then no jump that is written as a fraction is in the middle of a piece. There it would be taken for rounding,
which no shorter piece takes away.
"""
VERTEX_JUMP_TOLERANCE = 1e-12
"""What is given on two sides may differ at their vertex by this part of the larger of the two numbers there.

That is for users who round: `data_checks` refuses what differs by more, beyond the remainders of both, and
`bounds.constraint` takes away what differs by less.
"""
MAX_VERTEX_REMAINDER = 2.0**-26
"""Rounding hides whether data fit together at a vertex if it leaves fewer than half of the digits there.

They are those of the larger one of the two sides, for a number itself may be 0.
"""
ZERO_DATA_SIZE = 1e-140
"""Data of this size are taken for 0, see `data_checks.MIN_DATA_SIZE`."""
MIN_FLUX_CUT_ULPS = 4 * ARC_LENGTH_ERROR_ULPS
"""For q no piece is cut in parts shorter than half of this many units in the last place of the perimeter."""


class EdgePolynomials(NamedTuple):
    """The polynomials of an `Obstacle` on edges, at Q Gauss points of K intervals and at the edges' ends.

    The intervals lie on the edges `edge` (K,), and half of their length is `half_length` (K,). At the arc
    lengths s (K, Q) the polynomials have the values `value` and the derivatives `slope` (K, Q); the rule's
    `weights` (Q,) belong to [-1, 1]. `remainder`, `upper`, `slope_remainder` and `end_slope_remainder` (K,)
    are those of the obstacle, the last within `reach` of the ends of pieces.

    At the start, the end and the midpoint of all edges the polynomials have the values `ends` (nb, 3), from
    inside the edge. At an edge's start they may differ by `allowed_jumps` (nb,) where data fit together: on
    either of two that meet the polynomial is within its remainder of g. None is allowed, not even 0, where
    the obstacle `has_hidden_jump`.
    """

    edge: Index
    s: Array
    half_length: Array
    weights: Array
    value: Array
    slope: Array
    remainder: Array
    upper: Array
    slope_remainder: Array
    end_slope_remainder: Array
    reach: float
    ends: Array
    allowed_jumps: Array


@dataclass(frozen=True, eq=False)
class Obstacle(Piecewise):
    """g, -inf on sides that are free. Where two pieces meet on a side their polynomials agree.

    On clamped sides it is the given u, the derivative of which, by the arc length, is within
    `slope_remainder` (k,) of the polynomials'. Near a piece's ends, as far as places may be rounded, it may
    be that of the next piece, and is within `end_slope_remainder` (k,). Both are 0 on all other sides.

    At the vertices g is within `end_remainders` (2, n) of the `ends` (2, n): on the side that ends there,
    then on the one that starts there. Both are 0 on sides that are free.
    """

    slope_remainder: Array
    end_slope_remainder: Array
    ends: Array
    end_remainders: Array

    def means(self, s: Array) -> Array:
        """The polynomials' means between arc lengths s, from 0 to the perimeter, (m,)."""
        samples = self.sample(s, PIECE_DEGREE // 2 + 1)
        # Gauss points make integrals of degree PIECE_DEGREE exact on each interval
        cell = np.searchsorted(s, samples.middle) - 1
        integrals = samples.half_length * (samples.value @ samples.weights)
        return np.asarray(np.bincount(cell, integrals, len(s) - 1) / np.diff(s))

    @property
    def rounded_jumps(self) -> Array:
        """Differences (n,) of the `ends`, beyond their remainders, that are allowed to users who round."""
        return np.asarray(VERTEX_JUMP_TOLERANCE * np.abs(self.ends).max(axis=0))

    @property
    def has_hidden_jump(self) -> Mask:
        """Whether rounding hides at each vertex if the two `ends` fit together, (n,).

        So it is with steep data, as a place is rounded: u may jump there for all that is known.
        """
        # The digits that count are those of the largest number on the two sides
        sizes = np.full(self.polygon.n_sides, ZERO_DATA_SIZE)
        np.maximum.at(sizes, self.side, np.abs(self.c).sum(axis=0))
        remainder = self.end_remainders.sum(axis=0)
        differs = np.abs(np.diff(self.ends, axis=0)[0]) > self.rounded_jumps + remainder
        return ~differs & ~(remainder <= MAX_VERTEX_REMAINDER * np.maximum(sizes, np.roll(sizes, 1)))

    def sample_on_edges(self, s: Array, side: Index, chosen: Mask, n_intervals: int) -> EdgePolynomials:
        """The polynomials on the edges between arc lengths s (nb + 1,) of the perimeter, on the sides (nb,).

        The `chosen` edges (nb,) are cut into `n_intervals` equal ones, and where pieces end.
        """
        inner = s[:-1, None] + np.diff(s)[:, None] * np.arange(n_intervals) / n_intervals
        samples = self.sample(np.append(inner.ravel(), s[-1]))
        edge = np.searchsorted(s, samples.middle) - 1
        selected = chosen[edge]
        piece = samples.piece[selected]

        # At the ends of an edge the pieces count that lie on it
        start = self.find_pieces(s[:-1])
        end = np.clip(np.searchsorted(self.points, s[1:]) - 1, 0, len(self.side) - 1)
        places = np.stack([s[:-1], s[1:], 0.5 * (s[1:] + s[:-1])], axis=1)
        ends = self.evaluate(np.column_stack([start, end, self.find_pieces(places[:, 2])]), places)[0]

        # If `data_checks` accepts them, the two g at a vertex differ by at most `rounded_jumps` and twice the
        # `end_remainders`: their values are known up to these, and compared up to these
        allowed_jumps = self.remainder[start] + np.roll(self.remainder[end], 1)
        vertices = np.searchsorted(side, np.arange(self.polygon.n_sides))
        allowed_jumps[vertices] += self.rounded_jumps + 2 * self.end_remainders.sum(axis=0)
        allowed_jumps[vertices[self.has_hidden_jump]] = -np.inf
        return EdgePolynomials(
            edge=edge[selected],
            s=samples.s[selected],
            half_length=samples.half_length[selected],
            weights=samples.weights,
            value=samples.value[selected],
            slope=samples.slope[selected],
            remainder=self.remainder[piece],
            upper=self.upper[piece],
            slope_remainder=self.slope_remainder[piece],
            end_slope_remainder=self.end_slope_remainder[piece],
            reach=ARC_LENGTH_ERROR_ULPS * float(np.spacing(self.points[-1])),
            ends=ends,
            allowed_jumps=allowed_jumps,
        )


def enclose_obstacle(
    polygon: Polygon,
    model: SideModel,
    free: Sequence[int] = (),
    u_lower_bound: float = -np.inf,
    breakpoints: Iterable[SingularPoint] = (),
    clamped: Sequence[int] = (),
    slope_model: SideModel | None = None,
) -> Obstacle:
    """g on the sides that are not `free`, or the given u on those that are `clamped`.

    Below `u_lower_bound`, which u exceeds, it need not be known as well. It takes fewer pieces if these begin
    and end at the points where g is known not to be smooth. Each piece but a side's last is changed linearly
    to end where the next one begins. `slope_model`, which clamped sides need, is the derivative of u there by
    the arc length in side lengths.
    """
    pieces = enclose_in_pieces(polygon, model, free, u_lower_bound, breakpoints)
    # p(1) of a piece is taken linearly to p(-1) of the next: + gap (1 + sigma) / 2, at most |gap|
    side, _, _, c, rad, lower, upper = pieces
    gap = np.append(_jumps_of_polynomials(c), 0.0)
    gap[np.append(side[1:] != side[:-1], True)] = 0.0
    c[:2] += 0.5 * gap  # in `pieces`, too: rounding and slopes are those of the changed polynomials
    points = pieces.arc_lengths(polygon)
    rounding = pieces.rounding_errors(points)
    # A rounded place may lie on the neighbour of its piece
    remainder = _max_with_neighbours(rad + np.abs(gap) + rounding, side)
    slope_remainder, end_slope_remainder = _slope_remainders(polygon, pieces, points, clamped, slope_model)
    ends, end_remainders = _enclose_at_vertices(polygon, model, free, side, c, remainder)
    return Obstacle(
        polygon=polygon,
        points=points,
        side=side,
        c=c,
        remainder=remainder,
        lower=lower - rounding,
        upper=_max_with_neighbours(upper, side) + rounding,
        slope_remainder=slope_remainder,
        end_slope_remainder=end_slope_remainder,
        ends=ends,
        end_remainders=end_remainders,
    )


def _jumps_of_polynomials(c: Array) -> Array:
    """p_(i + 1)(-1) - p_i(1), (k - 1,): from the end of each polynomial c[:, i] to the start of the next."""
    return np.asarray((POWERS_AT_MINUS_ONE @ c)[1:] - c.sum(axis=0)[:-1])


def _enclose_at_vertices(
    polygon: Polygon, model: SideModel, free: Sequence[int], side: Index, c: Array, remainder: Array
) -> tuple[Array, Array]:
    """Values of g at the vertices, from both sides, and how far g may be from them, (2, n) each.

    `side`, `c` and `remainder` are those of the pieces, in the order of the boundary: piece j is the
    polynomial sum_i c[i, j] sigma^i, sigma from -1 to 1, within remainder[j] of g. On `free` sides, where
    there is no g, all values are 0, and are no enclosure.

    g is enclosed at the vertex itself, however little is known of it on the pieces beside the vertex. If no
    enclosure is known at the vertex, as next to a singularity, that of the piece there is taken.
    """
    n = polygon.n_sides
    ends = np.zeros((2, n))
    remainders = np.zeros((2, n))
    constrained_sides = np.setdiff1d(np.arange(n), free)
    # Row 0 has the end t = 1 of the side before the vertex, row 1 the start t = 0 of the side after it
    for row, t in ((0, 1.0), (1, 0.0)) if constrained_sides.size else ():
        place = np.full(len(constrained_sides), t)
        exact = enclose_on_intervals(model, constrained_sides, place, place)
        # the last piece of the side for t = 1, at sigma = 1; the first one for t = 0, at sigma = -1
        piece = np.searchsorted(side, constrained_sides, side="right" if t else "left") - int(t)
        value = c[:, piece].sum(axis=0) if t else POWERS_AT_MINUS_ONE @ c[:, piece]
        finite = np.isfinite(exact.rad)
        vertex = (constrained_sides + int(t)) % n
        ends[row, vertex] = np.where(finite, exact.c[0], value)
        remainders[row, vertex] = np.where(finite, exact.rad, remainder[piece])
    return ends, remainders


def _slope_remainders(
    polygon: Polygon,
    pieces: IntervalPieces,
    points: Array,
    clamped: Sequence[int],
    slope_model: SideModel | None,
) -> Array:
    """Bounds on |u' - p'| by arc length on each piece, row 0, and next to its ends, row 1, (2, k).

    Both are 0 on sides that are not clamped. The pieces lie between the arc lengths `points` (k + 1,), and
    `slope_model` is du/dt, t in side lengths. Where rounding moves a place across a piece's end, u' is that
    of the next piece, and within row 1 of this p'; at the ends of a side there is no such piece.
    """
    remainders = np.zeros((2, len(pieces.side)))
    rows = np.flatnonzero(np.isin(pieces.side, clamped))
    if not rows.size:
        return remainders
    assert slope_model is not None, "without its derivative, u is not known well enough on clamped sides"
    exact = enclose_on_intervals(slope_model, pieces.side[rows], pieces.start[rows], pieces.end[rows])
    k = np.arange(PIECE_DEGREE + 1.0)
    half = 0.5 * np.diff(points)[rows]
    length = polygon.lengths[pieces.side[rows]]
    # p' by the arc length: coefficients k c_k at the power k - 1, over half of the piece's length
    rises = np.roll(k[:, None] * pieces.c[:, rows], -1, axis=0) / half
    # terms of p' are rounded some 20 times by EPS / 2; places move by a quarter of this (`rounding_errors`)
    shift = 2 * ARC_LENGTH_ERROR_ULPS * np.spacing(points[-1]) / half
    rounding = np.abs(rises).sum(axis=0) * 16 * EPS + k @ np.abs(rises) * shift
    # |u' - p'| <= sum of |differences of coefficients| + the remainder of u' + rounding, of places, too
    remainder = np.abs(exact.c / length - rises).sum(axis=0) + exact.rad / length + rounding
    # Near an end u' may be that of the next piece: the jump of p' there, and what both are off
    jumps = np.abs(_jumps_of_polynomials(rises)) + remainder[1:] + remainder[:-1]
    jumps[np.diff(pieces.side[rows]) != 0] = 0.0
    remainders[:, rows] = remainder, np.maximum(np.append(jumps, 0.0), np.append(0.0, jumps))
    return remainders


def _max_with_neighbours(values: Array, side: Index) -> Array:
    """The largest value (k,) on each piece and those beside it on its side, where a rounded point may lie."""
    largest = values.copy()
    same = side[1:] == side[:-1]
    for targets, neighbours in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        largest[targets] = np.where(same, np.maximum(largest[targets], values[neighbours]), largest[targets])
    return largest


@dataclass(frozen=True, eq=False)
class GivenFlux(Piecewise):
    """q on the pieces where it is `is_given` (k,), and 0 on the others. It may jump.

    Near a jump q is known less well, as far as a short piece and the rounding of places reach: within `reach`
    of points[i] it differs from the polynomials on both sides by at most `jumps` (k + 1,)[i].
    """

    is_given: Mask
    jumps: Array
    reach: float

    @property
    def lower_bound(self) -> float:
        """A lower bound on q on the sides on which it is given; infinite if there are none."""
        return float(self.lower[self.is_given].min(initial=np.inf))


def enclose_given_flux(
    polygon: Polygon, model: SideModel, flux_sides: Sequence[int], breakpoints: Iterable[SingularPoint] = ()
) -> GivenFlux:
    """q, given on the sides `flux_sides`, and 0 elsewhere; `breakpoints` as in `enclose_obstacle`."""
    other_sides = np.setdiff1d(np.arange(polygon.n_sides), flux_sides).tolist()
    unit = float(np.spacing(polygon.perimeter))
    shortest = np.maximum(MIN_PIECE_PER_SIDE, MIN_FLUX_CUT_ULPS * unit / polygon.lengths)
    cuts = [*(SingularPoint(i, FIRST_CUT, 1) for i in flux_sides), *breakpoints]
    pieces = enclose_in_pieces(polygon, model, other_sides, breakpoints=cuts, min_length=shortest)
    points = pieces.arc_lengths(polygon)
    remainder = pieces.rad + pieces.rounding_errors(points)
    # Where two pieces meet q may have either value: |p_(i + 1)(-1) - p_i(1)|, and the remainders of both
    jumps = np.zeros(len(points))
    jumps[1:-1] = np.abs(_jumps_of_polynomials(pieces.c)) + remainder[1:] + remainder[:-1]
    jumps[1:-1][np.diff(pieces.side) != 0] = 0.0  # the place of a vertex is exact
    return GivenFlux(
        polygon=polygon,
        points=points,
        side=pieces.side,
        c=pieces.c,
        remainder=remainder,
        lower=pieces.lower,
        upper=pieces.upper,
        is_given=np.isin(pieces.side, flux_sides),
        jumps=jumps,
        reach=ARC_LENGTH_ERROR_ULPS * unit,
    )
