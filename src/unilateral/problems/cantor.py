"""Infinitely many transitions, truncated: contact on the intervals that a Cantor set leaves out, in turn.

Of every interval a generation keeps a share at either end and removes the middle. What odd generations
remove carries lambda = s^alpha (1 - (s/l)^2)_+^4, s the distance from its start and l its length, by harmonic
atoms whose cutoff ends contact; what even ones remove carries a gap, with slope 1 at both ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas.formula import Compiled, compile_numpy, pos
from unilateral.formulas.interval import total
from unilateral.formulas.taylor import EPS, Model, settled
from unilateral.geometry.curves import Kink, Singular
from unilateral.problems.atoms import Along, Local, Regularity, T
from unilateral.problems.harmonic import harmonic
from unilateral.problems.polar import THETA, Polar, R

Interval = tuple[sympy.Expr, sympy.Expr]
DUST = sympy.Rational(1, 100)
"""What is left is no part of the set, which has measure 0; its gap must not outweigh that of the removed."""
Part = tuple[Index, float, Array, list[Array]]


def divided(keep: sympy.Expr, generations: int) -> tuple[list[Interval], list[Interval], list[Interval]]:
    """The intervals of [0, 1] that odd generations remove, that even ones remove, and that are left."""
    left: list[Interval] = [(sympy.S.Zero, sympy.S.One)]
    removed: tuple[list[Interval], list[Interval]] = ([], [])
    for generation in range(generations):
        inner = [(a + keep * (b - a), b - keep * (b - a)) for a, b in left]
        removed[generation % 2].extend(inner)
        left = [pair for (a, b), (c, d) in zip(left, inner, strict=True) for pair in ((a, c), (d, b))]
    return *removed, left


def gap(keep: sympy.Expr, generations: int, at_vertices: sympy.Expr) -> sympy.Expr:
    """u - g as a formula in t: (t - c)(d - t)/(d - c) on what even generations remove.

    On what is left it is DUST of that, and linear from its value at the vertices.
    """
    _, removed, left = divided(keep, generations)
    tents = [pos((T - c) * (d - T), 1) / (d - c) for c, d in removed]
    tents += [DUST * pos((T - c) * (d - T), 1) / (d - c) for c, d in left[1:-1]]
    (_, first), (last, _) = left[0], left[-1]
    ends = pos(first - T, 1) / first + pos(T - last, 1) / (1 - last)
    return sympy.Add(at_vertices * ends, *tents)


@dataclass(frozen=True, eq=False)
class Cantor(Local):
    """The atom on a side; its place t is the side's start."""

    keep: sympy.Expr
    generations: int
    alpha: sympy.Expr
    regularity = Regularity(finite=False)

    @cached_property
    def _contact(self) -> Array:
        """(k, 2) ends of the contact intervals."""
        return np.array(sorted(divided(self.keep, self.generations)[0]), dtype=float)

    @cached_property
    def _unit(self) -> Compiled:
        """v, dv/dr, (dv/dtheta)/r and Delta v of the atom whose contact is [0, 1], in r and theta."""
        one = harmonic(self.polygon, self.side, sympy.S.Zero, self.alpha, sympy.S.One)
        return compile_numpy(list(one.symbolic), (R, THETA))

    def _parts(self, along: Array, into: Array) -> Iterator[Part]:
        """Per interval: the points (m,) of its support, its length l, theta (m,) and the unit atom at r/l."""
        near = np.flatnonzero(into < np.diff(self._contact).max())
        near = near[np.argsort(along[near], kind="stable")]
        for start, end in self._contact:
            length = end - start
            first, last = np.searchsorted(along[near], (start - length, start + length))
            points = near[first:last]
            x, y = along[points] - start, into[points]
            r = np.hypot(x, y)
            inside = (r > 0) & (r < length)
            theta = np.arctan2(y[inside], x[inside])
            yield points[inside], length, theta, self._unit(r[inside] / length, theta)

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        along, into = self.local_inside(points, offset)
        value, gradient, alpha = np.zeros(len(along)), np.zeros((len(along), 2)), float(self.alpha)
        for index, length, theta, (v, v_r, v_theta, _) in self._parts(along, into):
            value[index] += self.length * length ** (1 + alpha) * v
            gradient[index] += length**alpha * self.polar_to_xy(theta, v_r, v_theta)
        return value, gradient

    def source(self, points: Array, offset: Array | float = 0.0) -> Array:
        along, into = self.local_inside(points, offset)
        found, alpha = np.zeros(len(along)), float(self.alpha)
        for index, length, _, (v, _, _, laplacian) in self._parts(along, into):
            found[index] += self.length * length ** (1 + alpha) * v
            found[index] -= length ** (alpha - 1) / self.length * laplacian
        return found

    def vanishes(self, centre: Array, radius: Array) -> Mask:
        return self.local(centre)[1] - radius / self.length > np.diff(self._contact).max()

    def value_model(self, x: Model, y: Model) -> Model:
        return self._sum(Polar.value_model, x, y)

    def source_model(self, x: Model, y: Model) -> Model:
        return self._sum(Polar.source_model, x, y)

    def _sum(self, of: Callable[[Polar, Model, Model], Model], x: Model, y: Model) -> Model:
        """Over the atoms, each on the boxes that may meet its support."""
        (first, last), (low, _) = (z.range for z in self.local_models(x, y))
        c, rad, lower, upper = np.zeros_like(x.c), *np.zeros((3, len(x.rad)))
        for (start, end), atom in zip(self._contact, self._atoms, strict=True):
            at = np.flatnonzero((last >= 2 * start - end) & (first <= end) & (low <= end - start))
            if at.size:
                more = of(atom, x.on(at), y.on(at))
                c[:, at] += more.c
                rad[at] += more.rad + EPS * np.abs(c[:, at]).sum(axis=0)
                lower[at], upper[at] = total((lower[at], upper[at]), more.range)
        return settled(x.basis, c, rad, (lower, upper))

    @cached_property
    def _atoms(self) -> list[Polar]:
        """The same as harmonic atoms."""
        intervals = sorted(divided(self.keep, self.generations)[0])
        return [harmonic(self.polygon, self.side, a, self.alpha, b - a) for a, b in intervals]

    def trace_and_flux(self, side: int, along: Along) -> tuple[Array, Array]:
        """(k,) values of u and of its outward normal derivative on the side."""
        value, flux, alpha = np.zeros(len(along.t)), np.zeros(len(along.t)), float(self.alpha)
        for index, length, theta, (v, _, v_theta, _) in self._parts(along.t, np.zeros_like(along.t)):
            value[index] += self.length * length ** (1 + alpha) * v
            flux[index] += length**alpha * np.where(theta > 0, v_theta, -v_theta)
        return value, flux

    def kinks(self) -> list[Kink]:
        centres = self.centre + self._contact[:, :1] * self.length * self.frame[0]
        lengths = np.diff(self._contact)[:, 0] * self.length
        return [Kink((x, y), length) for (x, y), length in zip(centres.tolist(), lengths, strict=True)]

    def singular(self) -> list[Singular]:
        kinds = (int(sympy.Rational(self.alpha).q), 1)
        ends = self._contact.tolist()
        return [Singular(self.side, t, k) for pair in ends for t, k in zip(pair, kinds, strict=True)]
