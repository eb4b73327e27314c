"""Problems whose f and g are functions of one's own, known in points only: nothing is guaranteed for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.geometry.polygon import Polygon

Function = Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Sampled:
    """(1.1)-(1.2) with du/dn = 0 in place of the conditions (1.2) on `free_sides`.

    `f` takes arrays x, y of one shape and returns that shape; so does `g`, one per side.
    """

    name: str
    polygon: Polygon
    f: Function
    g: tuple[Function, ...]
    free_sides: tuple[int, ...] = ()

    def source(self, points: Array) -> Array:
        """f (...) at points (..., 2)."""
        return _values(self.f, points)

    def obstacle(self, side: Index, s: Array) -> Array:
        """g (k,) at arc lengths s (k,) of the sides (k,), 0 on free ones."""
        points, found = self.polygon.at(side, s), np.zeros(len(s))
        for i in np.unique(side).tolist():
            if i not in self.free_sides:
                found[side == i] = _values(self.g[i], points[side == i])
        return found


def _values(function: Function, points: Array) -> Array:
    x, y = np.moveaxis(points, -1, 0)
    return np.broadcast_to(np.asarray(function(x, y), dtype=float), x.shape)
