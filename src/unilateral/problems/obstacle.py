"""g on the sides of a polygon, enclosed: a continuous piecewise polynomial, and how far g is from it.

This is done once for a problem, whatever the mesh.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.geometry.curves import Singular
from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import ORDER, SIGNS, IntervalPieces, Piecewise, SideModel, in_pieces


@dataclass(frozen=True, eq=False)
class Obstacle(Piecewise):
    """g, -inf on sides that are free. Where two pieces meet on a side their polynomials agree."""

    def means(self, points: Array) -> Array:
        """(m,) the polynomials' means between the arc lengths `points` (m + 1,) of the perimeter."""
        cuts = np.union1d(points, self.points[(self.points > points[0]) & (self.points < points[-1])])
        x, w = np.polynomial.legendre.leggauss(ORDER // 2 + 1)
        middle, half = 0.5 * (cuts[1:] + cuts[:-1]), 0.5 * np.diff(cuts)
        value, _ = self.at(self.on(middle)[:, None], middle[:, None] + half[:, None] * x)
        cell = np.searchsorted(points, middle) - 1
        return np.asarray(np.bincount(cell, half * (value @ w), len(points) - 1) / np.diff(points))

    def at_vertex(self, vertex: int) -> tuple[float, float, float]:
        """The polynomials at a vertex, on the side before and the one after, and the sum of their doubts."""
        before = (vertex - 1) % self.polygon.n_sides
        last, first = np.flatnonzero(self.side == before)[-1], np.flatnonzero(self.side == vertex)[0]
        return (
            float(self.c[:, last].sum()),
            float(SIGNS @ self.c[:, first]),
            float(self.doubt[[last, first]].sum()),
        )


def enclosed(
    polygon: Polygon,
    model: SideModel,
    free: Sequence[int] = (),
    least: float = -np.inf,
    cuts: Iterable[Singular] = (),
) -> Obstacle:
    """g on the sides that are not `free`; below `least`, which u exceeds, it need not be known as well.

    It takes fewer pieces if these begin and end at the points where g is known not to be smooth.
    """
    return _joined(polygon, in_pieces(polygon, model, free, least, cuts))


def _joined(polygon: Polygon, pieces: IntervalPieces) -> Obstacle:
    """The obstacle: each piece but a side's last is changed linearly to end where the next one begins."""
    side, _, _, c, rad, lower, upper = pieces
    gap = np.append((SIGNS @ c)[1:] - c.sum(axis=0)[:-1], 0.0)
    gap[np.append(side[1:] != side[:-1], True)] = 0.0
    c[:2] += 0.5 * gap
    points = pieces.points(polygon)
    rounding = pieces.rounding(points)
    doubt = _of_neighbours(rad + np.abs(gap) + rounding, side)
    return Obstacle(polygon, points, side, c, doubt, lower - rounding, _of_neighbours(upper, side) + rounding)


def _of_neighbours(values: Array, side: Index) -> Array:
    """(k,) the largest value on a piece and those beside it on its side, where a rounded place may lie."""
    found, same = values.copy(), side[1:] == side[:-1]
    for one, other in ((slice(1, None), slice(None, -1)), (slice(None, -1), slice(1, None))):
        found[one] = np.where(same, np.maximum(found[one], values[other]), found[one])
    return found
