"""g on the sides of a polygon, enclosed: a continuous piecewise polynomial, and how far g is from it.

Every side is halved until g is a polynomial on each piece up to a tolerance near round-off (`taylor`), so
that no peak of g can hide; at a kink pieces become short. This is done once for a problem, whatever the mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas.taylor import EPS, Model, affine, basis
from unilateral.geometry.curves import Singular
from unilateral.geometry.polygon import Polygon

ObstacleModel = Callable[[Index, Model], Model]
"""g on intervals of the sides (k,), from the arc length in side lengths."""
ORDER = 7
SHARP = 1e-12
"""Of what g varies by above the least value that u can have: how far it may be from the polynomial."""
FLOOR = 1e-13
"""Of |g| on a piece: its rounding, which no shorter piece takes away."""
IN_VAIN = 4.0
"""Times the rounding of g at a point: a piece on which g is known that well is not cut."""
MOST_PIECES = 60_000
SHORTEST = 2.0**-44
"""Of a side."""
_SIGNS = np.where(np.arange(ORDER + 1) % 2, -1.0, 1.0)
"""Of the powers at -1."""


class _Pieces(NamedTuple):
    """Intervals [start, end] (k,) of sides (k,) in side lengths, with g's c (m, k), rad and range (k,)."""

    side: Index
    start: Array
    end: Array
    c: Array
    rad: Array
    lower: Array
    upper: Array

    def of(self, kept: Mask | Index) -> _Pieces:
        side, start, end = self.side[kept], self.start[kept], self.end[kept]
        return _Pieces(side, start, end, self.c[:, kept], self.rad[kept], self.lower[kept], self.upper[kept])


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Between arc lengths `points`[i] and `points`[i + 1] g is within `doubt`[i] of the polynomial c[:, i].

    Its variable is -1 and 1 at the ends; where they meet on a side the polynomials agree. `lower` and `upper`
    (k,) bound g there. Sides that are free have one piece each, with -inf for g.
    """

    polygon: Polygon
    points: Array
    side: Index
    c: Array
    doubt: Array
    lower: Array
    upper: Array

    def at(self, piece: Index, s: Array) -> tuple[Array, Array]:
        """The polynomials and their derivatives (...) on pieces (...) at arc lengths s (...)."""
        half = 0.5 * (self.points[1:] - self.points[:-1])[piece]
        sigma = np.clip((s - self.points[piece]) / half - 1, -1.0, 1.0)
        value, slope = np.zeros_like(sigma), np.zeros_like(sigma)
        for k in range(ORDER, -1, -1):
            slope = slope * sigma + value
            value = value * sigma + self.c[k][piece]
        return value, slope / half

    def on(self, s: Array) -> Index:
        """The pieces (...) on which the arc lengths s (...) of the perimeter lie."""
        return np.clip(np.searchsorted(self.points, s, side="right") - 1, 0, len(self.side) - 1)

    def means(self, points: Array) -> Array:
        """(m,) the polynomials' means between the arc lengths `points` (m + 1,) of the perimeter."""
        cuts = np.union1d(points, self.points[(self.points > points[0]) & (self.points < points[-1])])
        x, w = np.polynomial.legendre.leggauss(ORDER // 2 + 1)
        middle, half = 0.5 * (cuts[1:] + cuts[:-1]), 0.5 * np.diff(cuts)
        value, _ = self.at(self.on(middle)[:, None], middle[:, None] + half[:, None] * x)
        cell = np.searchsorted(points, middle) - 1
        return np.asarray(np.bincount(cell, half * (value @ w), len(points) - 1) / np.diff(points))

    def at_vertex(self, vertex: int) -> tuple[float, float, float]:
        """p at a vertex, by the side before and the one that begins there, and the doubt of both together."""
        before = (vertex - 1) % self.polygon.n_sides
        last, first = np.flatnonzero(self.side == before)[-1], np.flatnonzero(self.side == vertex)[0]
        return (
            float(self.c[:, last].sum()),
            float(_SIGNS @ self.c[:, first]),
            float(self.doubt[[last, first]].sum()),
        )

    def range(self, side: int) -> tuple[float, float]:
        """Bounds of g on a side."""
        here = self.side == side
        return float(self.lower[here].min()), float(self.upper[here].max())


def enclosed(
    polygon: Polygon,
    model: ObstacleModel,
    free: Sequence[int] = (),
    least: float = -np.inf,
    cuts: Iterable[Singular] = (),
) -> Obstacle:
    """g on the sides that are not `free`; below `least`, which u exceeds, it need not be known as well.

    It takes fewer pieces if these begin and end at the points where g is known not to be smooth.
    """
    side, start, end = _first_intervals(polygon, free, cuts)
    done, left = [_without(np.array(free, dtype=np.intp))], MOST_PIECES
    while len(side):
        now, left = _on_intervals(model, side, start, end), left - len(side)
        wide = _too_wide(_together([now, *done]), least)[: len(side)] & (end - start > SHORTEST)
        if wide.any():
            wide[wide] = ~_only_rounded(model, now.of(wide))
        if 2 * np.count_nonzero(wide) > left:
            wide[:] = False
        done.append(now.of(~wide))
        middle = 0.5 * (start + end)
        side, start, end = (
            np.concatenate([first[wide], second[wide]])
            for first, second in ((side, side), (start, middle), (middle, end))
        )
    return _joined(polygon, _together(done))


def _first_intervals(
    polygon: Polygon, free: Sequence[int], cuts: Iterable[Singular]
) -> tuple[Index, Array, Array]:
    """The sides that are not free, cut at those points: the sides (k,), starts and ends (k,)."""
    inner = {(point.side, point.t) for point in cuts if 0 < point.t < 1}
    held = np.setdiff1d(np.arange(polygon.n_sides), free).tolist()
    ends = sorted(
        {(side, t) for side in held for t in (0.0, 1.0)} | {each for each in inner if each[0] in held}
    )
    side, t = np.array([i for i, _ in ends], dtype=np.intp), np.array([t for _, t in ends])
    within = side[1:] == side[:-1]
    return side[:-1][within], t[:-1][within], t[1:][within]


def _only_rounded(model: ObstacleModel, pieces: _Pieces) -> Mask:
    """Where g is hardly better known in the middle of a piece than on all of it: shorter ones are in vain."""
    middle = 0.5 * (pieces.start + pieces.end)
    at_points = _on_intervals(model, pieces.side, middle, middle)
    return np.asarray(pieces.rad <= IN_VAIN * at_points.rad)


def _on_intervals(model: ObstacleModel, side: Index, start: Array, end: Array) -> _Pieces:
    t = affine(basis(1, ORDER), 0.5 * (start + end), 0.5 * (end - start)[None], (start, end))
    g = model(side, t)
    return _Pieces(side, start, end, g.c, g.rad, *g.range)


def _together(pieces: Sequence[_Pieces]) -> _Pieces:
    return _Pieces(*(np.concatenate(each, axis=-1) for each in zip(*pieces, strict=True)))


def _too_wide(pieces: _Pieces, least: float) -> Mask:
    """Where g is not known up to SHARP times its spread above `least`, or its depth below."""
    held = np.isfinite(pieces.lower)
    at_centre, size = pieces.c[0], np.abs(pieces.c).sum(axis=0)
    floor = max(least, float(at_centre[held].min(initial=np.inf)))
    scale = np.maximum(at_centre[held].max(initial=-np.inf) - floor, floor - pieces.lower)
    return np.asarray(~(pieces.rad <= np.maximum(SHARP * scale, FLOOR * size)))


def _without(side: Index) -> _Pieces:
    """The pieces of free sides."""
    zero = np.zeros(len(side))
    low = np.full(len(side), -np.inf)
    return _Pieces(side, zero, zero + 1, np.zeros((ORDER + 1, len(side))), zero, low, low)


def _joined(polygon: Polygon, pieces: _Pieces) -> Obstacle:
    """The pieces in order, each but the last of a side changed linearly to end where the next one begins."""
    side, start, _, c, rad, lower, upper = pieces.of(np.lexsort([pieces.start, pieces.side]))
    gap = np.append((_SIGNS @ c)[1:] - c.sum(axis=0)[:-1], 0.0)
    gap[np.append(side[1:] != side[:-1], True)] = 0.0
    c[:2] += 0.5 * gap
    points = np.append(polygon.starts[side] + start * polygon.lengths[side], polygon.perimeter)
    sizes, moved = np.abs(c), 8 * np.spacing(polygon.perimeter) / np.diff(points)
    rounding = 16 * EPS * sizes.sum(axis=0) + np.arange(ORDER + 1) @ sizes * moved
    doubt = _of_neighbours(rad + np.abs(gap) + rounding, side)
    return Obstacle(polygon, points, side, c, doubt, lower - rounding, _of_neighbours(upper, side) + rounding)


def _of_neighbours(values: Array, side: Index) -> Array:
    """(k,) the largest of each piece and those beside it on its side, where a place, rounded, may lie."""
    found, same = values.copy(), side[1:] == side[:-1]
    for one, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        found[one] = np.where(same, np.maximum(found[one], values[other]), found[one])
    return found
