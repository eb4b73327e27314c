"""The flux q that is given on free sides, enclosed: a piecewise polynomial, and how far q is from it.

q may jump. Near a jump it is known less well, as far as a short piece and the rounding of places reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.geometry.curves import Singular
from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import (
    PLACES,
    SHORTEST,
    SIGNS,
    IntervalPieces,
    Piecewise,
    SideModel,
    in_pieces,
)

CUT = (3 - 5**0.5) / 2
"""A side is first cut at this part of its length.

Then no jump that is written as a fraction is in the middle of a piece. There it would be taken for rounding,
which no shorter piece takes away.
"""
WIDE = 4 * PLACES
"""No piece is cut in parts shorter than half of this many units in the last place of the perimeter."""


@dataclass(frozen=True, eq=False)
class Flux(Piecewise):
    """q on the pieces where it is `given` (k,), and 0 on the others.

    Within `reach` of points[i] q differs from the polynomials on both sides by at most `jumps` (k + 1,)[i].
    """

    given: Mask
    jumps: Array
    reach: float

    @property
    def least(self) -> float:
        """A lower bound on q on the sides on which it is given; infinite if there are none."""
        return float(self.lower[self.given].min(initial=np.inf))


def enclosed(polygon: Polygon, model: SideModel, on: Sequence[int]) -> Flux:
    """q, given on the sides `on`, and 0 elsewhere."""
    without = np.setdiff1d(np.arange(polygon.n_sides), on).tolist()
    unit = float(np.spacing(polygon.perimeter))
    shortest = np.maximum(SHORTEST, WIDE * unit / polygon.lengths)
    pieces = in_pieces(polygon, model, without, cuts=[Singular(i, CUT, 1) for i in on], shortest=shortest)
    points = pieces.points(polygon)
    doubt = pieces.rad + pieces.rounding(points)
    side, _, _, c, _, lower, upper = pieces
    given, jumps = np.isin(side, on), _jumps(pieces, doubt)
    return Flux(polygon, points, side, c, doubt, lower, upper, given, jumps, PLACES * unit)


def none(polygon: Polygon) -> Flux:
    """No flux is given: q = 0 on free sides."""
    return enclosed(polygon, lambda _, t: t, ())


def _jumps(pieces: IntervalPieces, doubt: Array) -> Array:
    """(k + 1,) bounds on the jumps between neighbours on one side; 0 at vertices, whose place is exact."""
    ends = np.abs((SIGNS @ pieces.c)[1:] - pieces.c.sum(axis=0)[:-1]) + doubt[1:] + doubt[:-1]
    inner = np.where(pieces.side[1:] == pieces.side[:-1], ends, 0.0)
    return np.concatenate([[0.0], inner, [0.0]])
