"""Problems without a known solution: a polygon, f in it, an obstacle g or a flux q on its sides."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import sympy

from unilateral.arrays import Index
from unilateral.formulas.elementary import Steps, evaluate
from unilateral.formulas.formula import pos
from unilateral.formulas.positive import rounded
from unilateral.formulas.taylor import EPS, Model
from unilateral.geometry.curves import Kink
from unilateral.geometry.polygon import Polygon
from unilateral.problems import flux
from unilateral.problems.atoms import X, Y
from unilateral.problems.data import on_sides, places
from unilateral.problems.flux import Flux
from unilateral.problems.obstacle import Obstacle, enclosed
from unilateral.problems.ranges import range_in
from unilateral.problems.units import Units

FAR = 1e-100
"""Coefficients that differ by that factor make a line that is nowhere near, or a circle that is too large."""


@dataclass(frozen=True, eq=False)
class Problem:
    """(1.1)-(1.2) in the `units` of k and c, with k du/dn = q in place of (1.2) on `free_sides`.

    `f` is a formula in x, y; so is `g`, one per side, not used on free sides, and `q`, one per side, 0 on
    those that are not free; without any q it is 0.
    """

    name: str
    polygon: Polygon
    f: sympy.Expr
    g: tuple[sympy.Expr, ...]
    free_sides: tuple[int, ...]
    units: Units = field(default_factory=Units)
    q: tuple[sympy.Expr, ...] = ()

    @cached_property
    def jumps(self) -> dict[sympy.Expr, Kink]:
        """The steps pos(a, 0) in f, and the line or circle at which each changes between 0 and 1."""
        steps = sorted((power for power in self.f.atoms(pos) if power.args[1] == 0), key=str)
        return {step: kink for step in steps for kink in curve(step.args[0])}

    def source_model(self, x: Model, y: Model, steps: Steps) -> Model:
        """f on the boxes of x and y, on which the steps have those values, NaN for both."""
        return evaluate(self.f, {X: x, Y: y}, steps)

    def obstacle_model(self, side: Index, t: Model) -> Model:
        """g on intervals of the sides (k,), t the arc length in side lengths."""
        x, y = places(self.polygon, side, t)
        return on_sides(self.g, side, {X: x, Y: y})

    @cached_property
    def enclosed_obstacle(self) -> Obstacle:
        """g on the sides that are not free, enclosed.

        Below a = inf f / c less precisely: as u >= a, see `idle_sides`, u is also the solution for any other
        obstacle that is at most a where g is.
        """
        return enclosed(self.polygon, self.obstacle_model, self.free_sides, self.least)

    def flux_model(self, side: Index, t: Model) -> Model:
        """q on intervals of the sides (k,), t the arc length in side lengths."""
        x, y = places(self.polygon, side, t)
        return on_sides(self.q, side, {X: x, Y: y})

    @property
    def flux_sides(self) -> tuple[int, ...]:
        """Those on which q is not 0."""
        return tuple(side for side, formula in enumerate(self.q) if formula != 0)

    @cached_property
    def enclosed_flux(self) -> Flux:
        """q on these, enclosed."""
        return flux.enclosed(self.polygon, self.flux_model, self.flux_sides)

    @cached_property
    def range_of_f(self) -> tuple[float, float]:
        """Guaranteed bounds of f in Omega, infinite where none are found."""
        return range_in(self.polygon, self.f)

    @cached_property
    def least(self) -> float:
        """A guaranteed lower bound of u: inf f / c, see `idle_sides`; none where q may be below 0."""
        if self.enclosed_flux.least < 0:
            return -math.inf
        if self.units.c == 1:
            return self.range_of_f[0]
        quotient = self.range_of_f[0] / _rounded(self.units.c)
        return quotient - 4 * EPS * abs(quotient)

    def without_idle_sides(self) -> Problem:
        """The same problem without conditions on the sides that provably carry no contact."""
        return replace(self, free_sides=tuple(sorted({*self.free_sides, *self.idle_sides()})))

    def idle_sides(self) -> tuple[int, ...]:
        """The sides, not free, that provably carry no contact: sup g < ess inf f / c = a there.

        For u >= a where q >= 0, with k = c = 1: with w = (a - u)_+, v = u + w >= g is admissible, so
        (u, w)_1 >= (f, w)_0 + int q w >= a int w; but (u, w)_1 = -|grad w|^2 + int u w = a int w - ||w||_1^2,
        so w = 0, whatever holds on the other sides. Where q may be below 0 nothing is known. Where g < a <= u
        complementarity then gives lambda = 0. u_h obeys no such principle and may touch g there, so that to
        leave these sides out changes Lambda_H, and the discrete solution with it. Both bounds are guaranteed,
        by interval arithmetic; a side that they do not decide is not idle.
        """
        sides = (side for side in range(self.polygon.n_sides) if side not in self.free_sides)
        return tuple(side for side in sides if self.enclosed_obstacle.range(side)[1] < self.least)


def curve(a: sympy.Expr) -> list[Kink]:
    """The line or circle on which a formula is 0; ValueError if that is neither."""
    wanted = "must be linear, or c - (x - a)**2 - (y - b)**2 up to a factor"
    if not a.is_polynomial(X, Y):
        raise ValueError(wanted)
    of = _scaled(sympy.Poly(a, X, Y))
    for coefficient in of.coeffs():
        rounded(coefficient)
    square, c = of.coeff_monomial(X**2), of.coeff_monomial(1)
    slope = [of.coeff_monomial(z) for z in (X, Y)]
    others = of - sympy.Poly(square * (X**2 + Y**2), X, Y)
    if others.total_degree() > 1:
        raise ValueError(wanted)
    if square == 0:
        return _line(slope, c)
    if abs(square) < FAR:
        raise ValueError("is 0 on a circle that is too large; write it as a line")
    centre = [-each / (2 * square) for each in slope]
    radius = _rounded(sum(each**2 for each in centre) - c / square)
    place = (_rounded(centre[0]), _rounded(centre[1]))
    return [Kink(place, math.sqrt(radius), sign=1 if square > 0 else -1)] if radius > 0 else []


def _line(slope: list[sympy.Expr], c: sympy.Expr) -> list[Kink]:
    size = math.hypot(*map(_rounded, slope))
    if c == 0 and size == 0:
        raise ValueError("is 0 everywhere; leave it out")
    if size <= FAR * abs(_rounded(c)):
        return []
    square = sum(each**2 for each in slope)
    x, y = (_rounded(-c * each / square) for each in slope)
    return [Kink((x, y), 0.0, (-_rounded(slope[1]) / size, _rounded(slope[0]) / size))]


def _rounded(number: sympy.Expr) -> float:
    """The number nearest to an exact one, whatever cancels in it."""
    return float(rounded(number))


def _scaled(of: sympy.Poly) -> sympy.Poly:
    """Times a power of 2, so that its coefficients, and what is made of them, are finite numbers."""
    magnitudes = (int(sympy.log(abs(c.n(17))) / math.log(2)) for c in of.coeffs() if c != 0)
    return of * sympy.Integer(2) ** -max(magnitudes, default=0)
