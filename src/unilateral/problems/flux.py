"""The flux q that is given on free sides, enclosed: a piecewise polynomial, and how far q is from it.

q may jump. Near the place of a jump, a short piece and what rounding may do to places, it is known less well.
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
"""Of a side, where it is cut first: then no jump that is written as a fraction is in the middle of a piece.

There it would be taken for rounding, which no shorter piece takes away.
"""
WIDE = 4 * PLACES
"""Units in the last place of the perimeter: no piece is cut in parts shorter than half of that."""


@dataclass(frozen=True, eq=False)
class Flux(Piecewise):
    """q, `given` (k,) or 0 on the pieces.

    Within `reach` of points[i] q differs from the polynomials on both sides by at most `jumps` (k + 1,)[i].
    """

    given: Mask
    jumps: Array
    reach: float

    @property
    def least(self) -> float:
        """A lower bound of q, on sides where it is not 0 for being not given; infinite if there are none."""
        return float(self.lower[self.given].min(initial=np.inf))


def enclosed(polygon: Polygon, model: SideModel, on: Sequence[int]) -> Flux:
    """q on those sides."""
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
    """(k + 1,) what lies between neighbours on one side at most; 0 at vertices, whose place is exact."""
    ends = np.abs((SIGNS @ pieces.c)[1:] - pieces.c.sum(axis=0)[:-1]) + doubt[1:] + doubt[:-1]
    inner = np.where(pieces.side[1:] == pieces.side[:-1], ends, 0.0)
    return np.concatenate([[0.0], inner, [0.0]])
