"""Functions on the sides of a polygon, enclosed: a polynomial on each piece of a side, and how far off it is.

Every side is halved until a function is a polynomial on each piece up to a tolerance near round-off
(`taylor`), so that no peak of it can hide; at a kink or a jump pieces become short.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.formulas.taylor import EPS, TaylorModel, affine_model, monomial_basis
from unilateral.geometry.curves import SingularPoint
from unilateral.geometry.polygon import Polygon

SideModel = Callable[[Index, TaylorModel], TaylorModel]
"""A function on intervals of the sides (k,), from the arc length in side lengths."""
PIECE_DEGREE = 7
PIECE_TOLERANCE_PER_SPREAD = 1e-12
"""A function may differ from the polynomial by this part of its spread on the side, above what counts."""
PIECE_ROUNDING_PER_SIZE = 1e-13
"""The rounding of a function is this part of its size on a piece; no shorter piece takes that away."""
MIN_REMAINDER_PER_ROUNDING = 4.0
"""A piece is not cut if the function is known there up to this many times the rounding at a point."""
MAX_SIDE_PIECES = 60_000
"""No pieces are cut where more intervals than this would be tried."""
PIECES_PER_BLOCK = 1 << 11
"""This many pieces are treated at once, so that models of a long formula fit into the processor's cache."""
MIN_PIECE_PER_SIDE = 2.0**-44
"""Pieces are not cut if they are as short as this part of a side."""
ARC_LENGTH_ERROR_ULPS = 8.0
"""Places count as known up to this many units in the last place of the perimeter.

Rounding moves them by less than half of it (`IntervalPieces.rounding_errors`).
"""
POWERS_AT_MINUS_ONE = np.where(np.arange(PIECE_DEGREE + 1) % 2, -1.0, 1.0)
"""The values of the powers of sigma at sigma = -1."""


class IntervalPieces(NamedTuple):
    """Intervals [start, end] (k,) of the sides (k,) in side lengths, with a Taylor model on each.

    Its coefficients are c (m, k), its remainder is rad (k,), and its range is from lower to upper (k,).
    """

    side: Index
    start: Array
    end: Array
    c: Array
    rad: Array
    lower: Array
    upper: Array

    def select(self, selection: Mask | Index) -> IntervalPieces:
        """Some of the pieces, by a mask or an index."""
        fields: tuple[Any, ...] = self
        return IntervalPieces(*(field[..., selection] for field in fields))

    def arc_lengths(self, polygon: Polygon) -> Array:
        """The arc lengths of the ends of the pieces, if they are ordered, (k + 1,)."""
        return np.append(
            polygon.starts[self.side] + self.start * polygon.lengths[self.side], polygon.perimeter
        )

    def rounding_errors(self, s: Array) -> Array:
        """Bounds on the rounding errors of the polynomials at rounded places, (k,); s are `arc_lengths`."""
        # |p(sigma + d) - p(sigma)| <= d sum over k of k |c_k|, sigma = (s - s_j) / half - 1. Let a unit be
        # the spacing of floats at the perimeter. s_j is off by at most 3/2 units, for starts[i + 1], t L and
        # starts[i] + t L are rounded by half a unit each. Numbers below half the perimeter, as lengths are,
        # are rounded by a quarter. So a Gauss point s = (a + b) / 2 + x (b - a) / 2 is off by at most 5/4,
        # and the three operations of sigma add 3/4. In all d half is less than 4 units
        sizes = np.abs(self.c)
        shift = 0.5 * ARC_LENGTH_ERROR_ULPS * np.spacing(s[-1]) / (0.5 * np.diff(s))
        # Horner's rule rounds 16 times, by EPS / 2; twice that is allowed
        return np.asarray(16 * EPS * sizes.sum(axis=0) + np.arange(PIECE_DEGREE + 1) @ sizes * shift)


class PieceSamples(NamedTuple):
    """Polynomials at Q Gauss points of K intervals, each of which lies on one `piece` (K,).

    An interval has its midpoint at `middle` (K,), and half of its length is `half_length` (K,). At the arc
    lengths s (K, Q) the polynomials have the values `value` and the derivatives `slope` (K, Q). The rule's
    weights (Q,) belong to [-1, 1].
    """

    piece: Index
    middle: Array
    half_length: Array
    s: Array
    value: Array
    slope: Array
    weights: Array


@dataclass(frozen=True, eq=False)
class Piecewise:
    """A function that is near the polynomial c[:, i] between arc lengths `points`[i] and `points`[i + 1].

    It is within `remainder`[i] of it; the variable is -1 and 1 at the ends. `lower` and `upper` (k,) bound
    the function there. Sides without a function have one piece each, with -inf for both.
    """

    polygon: Polygon
    points: Array
    side: Index
    c: Array
    remainder: Array
    lower: Array
    upper: Array

    def evaluate(self, piece: Index, s: Array) -> tuple[Array, Array]:
        """The polynomials and their derivatives (...) on pieces (...) at arc lengths s (...)."""
        half = 0.5 * (self.points[1:] - self.points[:-1])[piece]
        sigma = np.clip((s - self.points[piece]) / half - 1, -1.0, 1.0)
        value = np.zeros_like(sigma)
        slope = np.zeros_like(sigma)
        # Horner's rule for p and p' at sigma in [-1, 1]
        for k in range(PIECE_DEGREE, -1, -1):
            slope = slope * sigma + value
            value = value * sigma + self.c[k][piece]
        return value, slope / half

    def find_pieces(self, s: Array) -> Index:
        """The pieces (...) on which the arc lengths s (...) of the perimeter lie."""
        return np.clip(np.searchsorted(self.points, s, side="right") - 1, 0, len(self.side) - 1)

    def sample(self, cuts: Array, count: int = PIECE_DEGREE + 1) -> PieceSamples:
        """The polynomials at `count` Gauss points of the intervals between `cuts` (k,) and ends of pieces."""
        ends = np.union1d(cuts, self.points)
        middle = 0.5 * (ends[1:] + ends[:-1])
        half = 0.5 * np.diff(ends)
        piece = self.find_pieces(middle)
        nodes, weights = np.polynomial.legendre.leggauss(count)
        s = middle[:, None] + half[:, None] * nodes
        value, slope = self.evaluate(piece[:, None], s)
        return PieceSamples(piece, middle, half, s, value, slope, weights)

    def range(self, side: int) -> tuple[float, float]:
        """Bounds on the function on a side."""
        rows = self.side == side
        return float(self.lower[rows].min()), float(self.upper[rows].max())


def enclose_in_pieces(
    polygon: Polygon,
    model: SideModel,
    excluded_sides: Sequence[int],
    relevant_above: float = -np.inf,
    breakpoints: Iterable[SingularPoint] = (),
    min_length: Array | float = MIN_PIECE_PER_SIDE,
) -> IntervalPieces:
    """The function on all sides but some: a polynomial and a remainder on each of as many pieces as needed.

    Fewer pieces are needed if they begin and end at the points where it is known not to be smooth:
    `breakpoints`. No piece that is as short as `min_length`, one number or one per side (n,), is cut. Values
    below `relevant_above` need not be known sharply (`_is_too_wide`).
    """
    side, start, end = _first_intervals(polygon, excluded_sides, breakpoints)
    # sides without a function are one empty piece each
    done = [_empty_pieces(np.array(excluded_sides, dtype=np.intp))]
    budget = MAX_SIDE_PIECES
    shortest = np.broadcast_to(min_length, polygon.n_sides)
    while len(side):
        current = enclose_on_intervals(model, side, start, end)
        budget = budget - len(side)
        # spreads need all pieces of a side; the first len(side) are those of this round
        wide = _is_too_wide(_join_pieces([current, *done]), relevant_above)[: len(side)]
        wide &= end - start > shortest[side]
        if wide.any():
            wide[wide] = ~_is_cut_in_vain(model, current.select(wide))
        # out of budget: the pieces stay as they are, with larger remainders
        if 2 * np.count_nonzero(wide) > budget:
            wide[:] = False
        done.append(current.select(~wide))
        middle = 0.5 * (start + end)
        side = np.concatenate([side[wide], side[wide]])
        start = np.concatenate([start[wide], middle[wide]])
        end = np.concatenate([middle[wide], end[wide]])
    pieces = _join_pieces(done)
    return pieces.select(np.lexsort([pieces.start, pieces.side]))


def _first_intervals(
    polygon: Polygon, excluded_sides: Sequence[int], breakpoints: Iterable[SingularPoint]
) -> tuple[Index, Array, Array]:
    """All sides but the excluded ones, cut at the breakpoints: the sides, the starts and the ends, (k,)."""
    inner = {(point.side, point.t) for point in breakpoints if 0 < point.t < 1}
    sides = np.setdiff1d(np.arange(polygon.n_sides), excluded_sides).tolist()
    ends = sorted(
        {(side, t) for side in sides for t in (0.0, 1.0)} | {point for point in inner if point[0] in sides}
    )
    side = np.array([i for i, _ in ends], dtype=np.intp)
    t = np.array([t for _, t in ends])
    # neighbours in this order are the ends of an interval, if they are on one side
    within = side[1:] == side[:-1]
    return side[:-1][within], t[:-1][within], t[1:][within]


def _is_cut_in_vain(model: SideModel, pieces: IntervalPieces) -> Mask:
    """Where a function is hardly better known in a piece's middle than on all of it: cuts are in vain."""
    middle = 0.5 * (pieces.start + pieces.end)
    at_points = enclose_on_intervals(model, pieces.side, middle, middle)
    return np.asarray(pieces.rad <= MIN_REMAINDER_PER_ROUNDING * at_points.rad)


def enclose_on_intervals(model: SideModel, side: Index, start: Array, end: Array) -> IntervalPieces:
    """A function on intervals (k,) of sides (k,), which begin and end at these places in side lengths."""
    blocks = []
    for block in row_blocks(len(side), PIECES_PER_BLOCK):
        a = start[block]
        b = end[block]
        # t = (a + b)/2 + (b - a)/2 sigma
        t = affine_model(monomial_basis(1, PIECE_DEGREE), 0.5 * (a + b), 0.5 * (b - a)[None], (a, b))
        values = model(side[block], t)
        blocks.append(IntervalPieces(side[block], a, b, values.c, values.rad, *values.range))
    return _join_pieces(blocks)


def _join_pieces(pieces: Sequence[IntervalPieces]) -> IntervalPieces:
    return IntervalPieces(*(np.concatenate(arrays, axis=-1) for arrays in zip(*pieces, strict=True)))


def _is_too_wide(pieces: IntervalPieces, relevant_above: float) -> Mask:
    """Where the remainder is over PIECE_TOLERANCE_PER_SPREAD of the side's spread above `relevant_above`.

    On a piece where the function is below that, its depth below it counts, if that is more.
    Each side has its own scale, because the numbers of another side may be of another size.
    """
    n = int(pieces.side.max(initial=-1)) + 1
    bounded = np.isfinite(pieces.lower)
    at_centre = pieces.c[0]
    size = np.abs(pieces.c).sum(axis=0)
    lowest = np.full(n, np.inf)
    highest = np.full(n, -np.inf)
    np.minimum.at(lowest, pieces.side[bounded], at_centre[bounded])
    np.maximum.at(highest, pieces.side[bounded], at_centre[bounded])
    # The spread of the constant terms above `relevant_above`, or how far below it the function may be
    floor = np.maximum(relevant_above, lowest)[pieces.side]
    scale = np.maximum(highest[pieces.side] - floor, floor - pieces.lower)
    return np.asarray(
        ~(pieces.rad <= np.maximum(PIECE_TOLERANCE_PER_SPREAD * scale, PIECE_ROUNDING_PER_SIZE * size))
    )


def _empty_pieces(side: Index) -> IntervalPieces:
    """The pieces of sides without a function."""
    zero = np.zeros(len(side))
    low = np.full(len(side), -np.inf)
    return IntervalPieces(side, zero, zero + 1, np.zeros((PIECE_DEGREE + 1, len(side))), zero, low, low)
