"""Problems whose f and g are functions of one's own, known in points only: nothing is guaranteed for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon
from unilateral.problems.units import Units

Function = Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Sampled:
    """(1.1)-(1.2) in the `units` of k and c, with du/dn = 0 in place of (1.2) on `free_sides`.

    `f` takes arrays x, y of one shape and returns that shape; so does `g`, one per side.
    """

    name: str
    polygon: Polygon
    f: Function
    g: tuple[Function, ...]
    free_sides: tuple[int, ...] = ()
    units: Units = field(default_factory=Units)

    def source(self, points: Array) -> Array:
        """f (...) at points (..., 2); raises InputError where it is no finite number."""
        return values(self.f, points, f"{self.name}, field f")

    def obstacle(self, side: Index, s: Array) -> Array:
        """g (k,) at arc lengths s (k,) of the sides (k,), 0 on free ones."""
        points, found = self.polygon.at(side, s), np.zeros(len(s))
        for i in np.unique(side).tolist():
            if i not in self.free_sides:
                found[side == i] = values(self.g[i], points[side == i], f"{self.name}, field g[{i}]")
        return found


def values(function: Function, points: Array, where: str) -> Array:
    """(...) at points (..., 2); raises InputError where the function has no finite number."""
    x, y = np.moveaxis(points, -1, 0)
    with np.errstate(all="ignore"):
        found = np.broadcast_to(np.asarray(function(x, y), dtype=float), x.shape)
    if not np.isfinite(found).all():
        at = np.unravel_index(np.argmin(np.isfinite(found)), found.shape)
        raise InputError(f"{where}: the function is {found[at]} at ({x[at]:.6g}, {y[at]:.6g})")
    return found
