"""Problems whose f, g and q are functions of one's own, known in points only: nothing is guaranteed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon
from unilateral.problems.units import Units

Function = Callable[[Array, Array], Array]


@dataclass(frozen=True, eq=False)
class Sampled:
    """(1.1)-(1.2) in the `units` of k and c, with k du/dn = q in place of (1.2) on `free_sides`.

    `f` takes arrays x, y of one shape and returns that shape; so do `g` and `q`, one per side; without any q
    it is 0.
    """

    name: str
    polygon: Polygon
    f: Function
    g: tuple[Function, ...]
    free_sides: tuple[int, ...] = ()
    units: Units = field(default_factory=Units)
    q: tuple[Function, ...] = ()

    def source(self, points: Array) -> Array:
        """f (...) at points (..., 2); raises InputError where it is no finite number."""
        return values(self.f, points, f"{self.name}, field f")

    def obstacle(self, side: Index, s: Array) -> Array:
        """g (k,) at arc lengths s (k,) of the sides (k,), 0 on free ones."""
        held = set(range(self.polygon.n_sides)) - {*self.free_sides}
        return self._on_sides({i: self.g[i] for i in held}, "g", side, s)

    def flux(self, side: Index, s: Array) -> Array:
        """q (k,) there, 0 on sides that are not free."""
        return self._on_sides({i: self.q[i] for i in self.free_sides if self.q}, "q", side, s)

    def _on_sides(self, functions: Mapping[int, Function], name: str, side: Index, s: Array) -> Array:
        points, found = self.polygon.at(side, s), np.zeros(len(s))
        for i in np.intersect1d(side, [*functions]).astype(int).tolist():
            found[side == i] = values(functions[i], points[side == i], f"{self.name}, field {name}[{i}]")
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
