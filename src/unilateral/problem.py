"""Problems without a known solution: a polygon, f in it and an obstacle g on its sides."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import sympy
from numpy.typing import NDArray

from unilateral.atoms import Kink, Singular, T, X, Y
from unilateral.enclosure import SAME, least_value, linear_pieces
from unilateral.expression import Compiled, compile_numpy, kinks, pos
from unilateral.mesh_io import segment_distances
from unilateral.polygon import Polygon

Array = NDArray[np.float64]
Index = NDArray[np.intp]
SHORT = 1 / 32
"""Of a side: on pieces of at least that length quadrature sees what is linear, on every mesh."""
LINEAR, FAIRLY_LINEAR = 0.01, 0.1
"""Of g's range on a side: how far g may be from linear on such a piece, and on a shorter one."""
ROUNDED = 1e-13
"""Of the largest |g| on a side: what its rounding may be."""
ENOUGH = 1.5
"""A bound of |f| at most that much larger than a value met is sharp."""
EXPANDED = 8
"""The largest degree at which polynomials are expanded; high ones lose more by it than they gain."""


@dataclass(frozen=True, eq=False)
class Problem:
    """(1.1)-(1.2) with du/dn = 0 in place of the conditions (1.2) on `free_sides`.

    `f` is a formula in x, y; `g` holds one in t, the arc length in side lengths, per side, and is not used on
    free sides. It has the methods of `Case` that do not need the solution.
    """

    name: str
    polygon: Polygon
    f: sympy.Expr
    g: tuple[sympy.Expr, ...]
    free_sides: tuple[int, ...]

    def source(self, points: Array, offset: Array | float = 0.0) -> Array:
        """f (k,) at the places points + offset (k, 2)."""
        with np.errstate(all="ignore"):  # f is finite, as its enclosure says; parts of it need not be
            return self._source(*(points + offset).T)[0]

    def obstacle(self, side: Index, s: Array) -> tuple[Array, Array]:
        """g (k,) and dg/ds (k,) at the arc lengths s (k,) of the sides (k,)."""
        t = s / self.polygon.lengths[side]
        g, slope = np.zeros(len(s)), np.zeros(len(s))
        for i in np.unique(side):
            here = side == i
            with np.errstate(all="ignore"):
                g[here], slope[here] = self._obstacles[i](t[here])
        return g, slope / self.polygon.lengths[side]

    @cached_property
    def _source(self) -> Compiled:
        return compile_numpy([self.f], (X, Y))

    @cached_property
    def _obstacles(self) -> list[Compiled]:
        return [compile_numpy([g, g.diff(T)], (T,)) for g in self.g]

    def kinks(self) -> list[Kink]:
        """The curves in Omega across which f is only finitely smooth."""
        powers = sorted(self.f.atoms(pos), key=str)
        return [replace(kink, jump=bool(k < 1)) for a, k in (p.args for p in powers) for kink in curve(a)]

    def flux_singular(self) -> list[Singular]:
        """None is known: where contact ends is part of the solution."""
        return []

    def singular(self) -> list[Singular]:
        """The points of sides at which f or g is only finitely smooth, or g varies fast.

        Raises ValueError where g varies too fast to be resolved.
        """
        return self._singular

    @cached_property
    def _singular(self) -> list[Singular]:
        found = [point for kink in self.kinks() for point in kink.crossings(self.polygon)]
        found += self._fast
        for side, g in enumerate(self.g):
            found += [Singular(side, t, int(k.q)) for t, k in kinks(g, T) if 0 <= t <= 1]
        return found

    @cached_property
    def _fast(self) -> list[Singular]:
        """The ends of the pieces, shorter than SHORT, that it takes for g to be all but linear on all.

        Only where g is above c = ess inf f, and of its range only what is: as u >= c, see `idle_sides`, u is
        also the solution for any other obstacle that is at most c where g is.
        """
        sides = (side for side in range(self.polygon.n_sides) if side not in self.free_sides)
        return [Singular(side, t, 1) for side in sides for t in self._fast_on(side)]

    def _fast_on(self, side: int) -> list[float]:
        least, met = self.range_of_f()[0], self._met_of_g(side)
        low, high = (max(value, least) for value in met)
        inner = [t for t, _ in kinks(self.g[side], T) if 0 < t < 1]
        spread, tiny = high - low, float(np.finfo(float).tiny)
        rounding = max(SAME * max(abs(low), abs(high)), ROUNDED * max(map(abs, met)), tiny)

        def tolerance(lengths: Array) -> Array:
            return np.maximum(np.where(lengths < SHORT, FAIRLY_LINEAR, LINEAR) * spread, rounding)

        try:
            ends = linear_pieces(self.g[side], T, np.unique([0.0, *inner, 1.0]), tolerance, least)
        except ValueError as error:
            raise ValueError(f"on side {side} {error}") from None
        short = np.diff(ends) < SHORT
        found = ends[np.append(short, False) | np.append(False, short)]
        return [t for t in found.tolist() if 0 < t < 1]

    @cached_property
    def largest_source(self) -> float:
        """A guaranteed bound of |f| in Omega, infinite where none is found."""
        return max(map(abs, self.range_of_f()))

    def range_of_f(self) -> tuple[float, float]:
        """Guaranteed bounds of f in Omega, infinite where none are found."""
        return self._enclosed_f[0], -self._enclosed_f[1]

    @cached_property
    def largest_met(self) -> float:
        """The largest |f| that the search for its bounds met."""
        return max(map(abs, self._enclosed_f[2:]))

    @cached_property
    def _enclosed_f(self) -> tuple[float, float, float, float]:
        """Lower bounds of f and of -f, and the least values of both that were met.

        By f as it is given and, as long as that is not sharp, in other forms, in which less may cancel.
        """
        lower, upper, least, most = -math.inf, -math.inf, math.inf, math.inf
        for f, origin in self._forms():
            (low, met), (high, met_above) = (self._least_of(e, origin) for e in (f, -f))
            lower, upper = max(lower, low), max(upper, high)
            least, most = min(least, met), min(most, met_above)
            if max(-lower, -upper) <= ENOUGH * max(abs(least), abs(most)):
                break
        return lower, upper, least, most

    def _forms(self) -> Iterator[tuple[sympy.Expr, Array]]:
        """f; with powers collected; polynomials of low degree expanded about the centre of Omega's box."""
        yield self.f, np.zeros(2)
        yield sympy.powsimp(self.f), np.zeros(2)
        if self.f.is_polynomial(X, Y) and sympy.total_degree(self.f, X, Y) <= EXPANDED:
            centre = self._box.mean(axis=1)
            moved = {z: z + sympy.Rational(c) for z, c in zip((X, Y), centre.tolist(), strict=True)}
            yield sympy.expand(self.f.subs(moved, simultaneous=True)), centre

    def _least_of(self, f: sympy.Expr, origin: Array) -> tuple[float, float]:
        """`least_value` in Omega of f in coordinates from that origin (2,)."""

        def part(boxes: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
            return self._part(boxes + origin[:, None])

        return least_value(f, (X, Y), self._box - origin[:, None], part)

    @property
    def _box(self) -> Array:
        return np.stack([self.polygon.vertices.min(axis=0), self.polygon.vertices.max(axis=0)], axis=1)

    def range_of_g(self, side: int) -> tuple[float, float]:
        """Guaranteed bounds of g on a side, infinite where none are found."""
        (lower, _), (upper, _) = self._enclosed_g[side]
        return lower, -upper

    def _met_of_g(self, side: int) -> tuple[float, float]:
        """The least and the largest value that the search for these bounds met: a range never too wide."""
        (_, least), (_, most) = self._enclosed_g[side]
        return least, -most

    @cached_property
    def _enclosed_g(self) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        """`least_value` of g and of -g on each side, 0 where it is free."""
        unit = np.array([[0.0, 1.0]])
        return [(least_value(g, (T,), unit), least_value(-g, (T,), unit)) for g in self.g]

    def _part(self, boxes: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which of the boxes (k, 2, 2) may meet the polygon, and which have their centre in it."""
        centres, half = boxes.mean(axis=2), 0.5 * np.hypot(*(boxes[..., 1] - boxes[..., 0]).T)
        v = self.polygon.vertices
        near = segment_distances(centres, v, np.roll(v, -1, axis=0)).min(axis=1) <= half * (1 + 1e-9)
        inside = _inside(self.polygon, centres)
        return near | inside, inside

    def idle_sides(self) -> tuple[int, ...]:
        """The sides, not free, that provably carry no contact: sup g < ess inf f = c there.

        For u >= c: with w = (c - u)_+, v = u + w >= g is admissible, so (u, w)_1 >= (f, w)_0 >= c int w; but
        (u, w)_1 = -|grad w|^2 + int u w = c int w - ||w||_1^2, so w = 0, whatever holds on the other sides.
        Where g < c <= u complementarity then gives lambda = 0. u_h obeys no such principle and may touch g
        there, so that to leave these sides out changes Lambda_H, and the discrete solution with it. Both
        bounds are guaranteed, by interval arithmetic; a side that they do not decide is not idle.
        """
        least = self.range_of_f()[0]
        sides = (side for side in range(self.polygon.n_sides) if side not in self.free_sides)
        return tuple(side for side in sides if self.range_of_g(side)[1] < least)


def curve(a: sympy.Expr) -> list[Kink]:
    """The line or circle on which a formula is 0; ValueError if that is neither."""
    wanted = "must be linear, or c - (x - a)**2 - (y - b)**2 up to a factor"
    if not a.is_polynomial(X, Y):
        raise ValueError(wanted)
    of = sympy.Poly(a, X, Y)
    square, c = of.coeff_monomial(X**2), float(of.coeff_monomial(1))
    slope = np.array([float(of.coeff_monomial(z)) for z in (X, Y)])
    others = of - sympy.Poly(square * (X**2 + Y**2), X, Y)
    if others.total_degree() > 1:
        raise ValueError(wanted)
    if square == 0:
        size = float(np.hypot(*slope))
        centre = -c * slope / size**2
        return [Kink(tuple(centre.tolist()), 0.0, (-slope[1] / size, slope[0] / size))]
    centre = -slope / (2 * float(square))
    radius = float(centre @ centre) - c / float(square)
    return [Kink(tuple(centre.tolist()), math.sqrt(radius))] if radius > 0 else []


def _inside(polygon: Polygon, points: Array) -> NDArray[np.bool_]:
    """Which of the points (k, 2) lie in the polygon: a ray from them crosses an odd number of sides."""
    (x0, y0), (x1, y1) = polygon.vertices.T, np.roll(polygon.vertices, -1, axis=0).T
    x, y = points[:, :1], points[:, 1:]
    with np.errstate(all="ignore"):
        crossed = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return crossed.sum(axis=1) % 2 == 1
