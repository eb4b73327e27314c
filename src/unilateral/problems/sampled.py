"""Problems whose f, g and q are the user's functions, known in points only: nothing is guaranteed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.polygon import Polygon
from unilateral.problems.units import Units

Function = Callable[[Array, Array], Array]
JUMP = 2.0**-26
"""A jump up to this part of the largest |g| at a vertex may come from rounding.

This allows for functions that keep half of the digits.
"""


@dataclass(frozen=True, eq=False)
class Sampled:
    """-k lap u + c u = f with contact, but k du/dn = q on `free_sides`; `units` come from k and c.

    `f` takes arrays x, y of one shape and returns that shape; so do the functions of `g` and `q`, one per
    side. If `q` is empty, the flux is 0.
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
        """q (k,) at arc lengths s (k,) of the sides (k,), 0 on those that are not free."""
        return self._on_sides({i: self.q[i] for i in self.free_sides if self.q}, "q", side, s)

    def _on_sides(self, functions: Mapping[int, Function], name: str, side: Index, s: Array) -> Array:
        points, numbers = self.polygon.at(side, s), np.zeros(len(s))
        for i in np.intersect1d(side, [*functions]).astype(int).tolist():
            numbers[side == i] = values(functions[i], points[side == i], f"{self.name}, field {name}[{i}]")
        return numbers


def check_vertices(of: Sampled) -> None:
    """Raises InputError where g jumps at a vertex: then no u in H^1 has that trace."""
    n, v = of.polygon.n_sides, of.polygon.vertices
    held = [side for side in range(n) if side not in of.free_sides]
    ends = {i: values(of.g[i], v[[i, (i + 1) % n]], f"{of.name}, field g[{i}]") for i in held}
    largest = max(float(np.abs(each).max()) for each in ends.values())
    for side, before in ((side, (side - 1) % n) for side in held if (side - 1) % n in ends):
        end, start = ends[before][1], ends[side][0]
        if abs(start - end) > JUMP * largest:
            raise jump_of_g(of.name, before, end, side, start)


def jump_of_g(name: str, before: int, end: float, side: int, start: float) -> InputError:
    """The refusal of a g with the value `end` at the end of the side before and `start` where one begins."""
    return InputError(
        f"{name}, field g: it jumps at vertex {side}, from {end:.6g} on side {before} to "
        f"{start:.6g} on side {side}; it has to be continuous"
    )


def values(function: Function, points: Array, where: str) -> Array:
    """Values (...) at points (..., 2); raises InputError where the function fails or is no finite number."""
    x, y = np.moveaxis(points, -1, 0)
    try:
        with np.errstate(all="ignore"):
            given = np.asarray(function(x, y))
            if np.iscomplexobj(given):
                raise InputError(f"{where}: the function returns complex numbers; it has to return real ones")
            numbers = np.broadcast_to(np.asarray(given, dtype=float), x.shape)
    except InputError:
        raise
    except Exception as error:  # whatever a function of one's own may raise
        raise InputError(
            f"{where}: the function failed ({type(error).__name__}: {error}); it has to take two arrays "
            "x and y and return numbers of their shape, such as lambda x, y: np.where(x > 1/2, 1, 0)"
        ) from error
    if not np.isfinite(numbers).all():
        at = np.unravel_index(np.argmin(np.isfinite(numbers)), numbers.shape)
        raise InputError(f"{where}: the function is {numbers[at]} at ({x[at]:.6g}, {y[at]:.6g})")
    return numbers
