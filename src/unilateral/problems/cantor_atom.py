"""Infinitely many transitions, truncated: contact on what every other generation of a Cantor set removes.

A generation keeps a share of every interval at either end and removes the middle. The intervals that odd
generations remove carry lambda = s^alpha (1 - (s/l)^2)_+^4, s the distance from the start and l the length,
by harmonic atoms whose cutoff ends contact. Those that even ones remove carry a gap, like s^gamma at both
ends.

There are l^{-d} intervals of about the length l, d the dimension of the set, and what is like s^k on each of
them has a norm in H^tau with the square sum l^{2k + 1 - 2 tau - d}: it lies in H^tau for tau < k + (1 - d)/2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import log
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas import interval
from unilateral.formulas.exact_numbers import pos
from unilateral.formulas.expression import ONE, Expression, number, total
from unilateral.formulas.formula import Compiled, compile_numpy
from unilateral.formulas.taylor import EPS, Model, settled
from unilateral.geometry.curves import Kink, Singular
from unilateral.problems.atoms import Along, Local, Regularity, T
from unilateral.problems.polar_atoms import Polar, harmonic

Interval = tuple[Fraction, Fraction]
DUST = Fraction(1, 100)
"""The gap on the intervals that are left is multiplied by this.

They are no part of the set, which has measure 0, and their gap must not outweigh that of the removed ones.
"""
Parts = tuple[Index, Array, Array, list[Array]]


class Family(NamedTuple):
    """The set between t = inset and t = 1 - inset: the share kept at either end, and how many generations."""

    keep: Fraction
    generations: int
    inset: Fraction

    @property
    def dimension(self) -> float:
        """The dimension of the set that is not truncated."""
        return log(2) / log(1 / self.keep)

    def order(self, power: Fraction) -> float:
        """A function that is like s^power on the removed intervals is in H^tau for every tau below this."""
        return float(power) + (1 - self.dimension) / 2

    def divided(self) -> tuple[list[Interval], list[Interval], list[Interval]]:
        """The intervals that odd generations remove, that even ones remove, and that are left."""
        left: list[Interval] = [(self.inset, 1 - self.inset)]
        removed: tuple[list[Interval], list[Interval]] = ([], [])
        for generation in range(self.generations):
            inner = [(a + self.keep * (b - a), b - self.keep * (b - a)) for a, b in left]
            removed[generation % 2].extend(inner)
            left = [pair for (a, b), (c, d) in zip(left, inner, strict=True) for pair in ((a, c), (d, b))]
        return *removed, left


def gap(family: Family, gamma: Fraction) -> Expression:
    """u - g as a formula in t: ((t - c)(d - t)/(d - c))^gamma on what even generations remove.

    On what is left it is DUST times that. From the set's ends it grows like s^gamma to the vertices.
    """
    _, removed, left = family.divided()
    parts = [pos(family.inset - T, gamma), pos(T - 1 + family.inset, gamma)]
    parts += [pos((T - c) * (d - T), gamma) / number(d - c) ** gamma for c, d in removed]
    parts += [DUST * pos((T - c) * (d - T), gamma) / number(d - c) ** gamma for c, d in left]
    return total(term for part in parts for term in part.terms)


def _summed(index: Index, values: Array, points: Array) -> Array:
    """(k,) the values (m,) added up at the k points whose numbers are `index` (m,)."""
    return np.bincount(index, values, len(points)).astype(float, copy=False)


@dataclass(frozen=True, eq=False)
class Cantor(Local):
    """The atom on a side; its place t is the side's start."""

    family: Family
    alpha: Fraction

    @property
    def flux_order(self) -> float:
        """lambda is in H^sigma on the side for every sigma below this."""
        return self.family.order(self.alpha)

    @property
    def regularity(self) -> Regularity:
        bounded = self.alpha >= 0
        order = self.flux_order
        return Regularity(order > 1 / 2, bounded, order > 0, bounded, finite=False)

    @cached_property
    def _contact(self) -> Array:
        """(k, 2) ends of the contact intervals."""
        return np.array(sorted(self.family.divided()[0]), dtype=float)

    @cached_property
    def _unit(self) -> Compiled:
        """v, dv/dr, (dv/dtheta)/r and Delta v of the atom whose contact is [0, 1], in r and theta."""
        one = harmonic(self.polygon, self.side, 0.0, self.alpha, cutoff=ONE)
        return compile_numpy(one.derived, ("r", "theta"))

    def _parts(self, along: Array, into: Array) -> Parts:
        """The points (m,), one support after another, and there l and theta (m,) and the unit atom at r/l."""
        starts = self._contact[:, 0]
        lengths = np.diff(self._contact)[:, 0]
        near = np.flatnonzero(into < lengths.max())
        near = near[np.argsort(along[near], kind="stable")]
        ends = np.searchsorted(along[near], [starts - lengths, starts + lengths])
        points = np.concatenate([near[first:last] for first, last in ends.T])
        interval = np.repeat(np.arange(len(starts)), np.diff(ends, axis=0)[0])
        x = along[points] - starts[interval]
        y = into[points]
        length = lengths[interval]
        r = np.hypot(x, y)
        inside = (r > 0) & (r < length)
        theta = np.arctan2(y[inside], x[inside])
        length = length[inside]
        return points[inside], length, theta, self._unit(r[inside] / length, theta)

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        return self.whole(points, offset)[:2]

    def whole(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array, Array]:
        along, into = self.local_inside(points, offset)
        index, length, theta, (v, v_r, v_theta, laplacian) = self._parts(along, into)
        scale = length ** float(self.alpha)
        size = self.length * length
        slopes = self.polar_to_xy(theta, scale * v_r, scale * v_theta).T
        value = _summed(index, size * scale * v, along)
        dx = _summed(index, slopes[0], along)
        dy = _summed(index, slopes[1], along)
        f = _summed(index, scale * (size * v - laplacian / size), along)
        return value, np.column_stack([dx, dy]), f

    def vanishes(self, centre: Array, radius: Array) -> Mask:
        return self.local(centre)[1] - radius / self.length > np.diff(self._contact).max()

    def value_model(self, x: Model, y: Model) -> Model:
        return self._sum(Polar.value_model, x, y)

    def source_model(self, x: Model, y: Model) -> Model:
        return self._sum(Polar.source_model, x, y)

    def _sum(self, of: Callable[[Polar, Model, Model], Model], x: Model, y: Model) -> Model:
        """The sum over the atoms, each on the boxes that may meet its support."""
        t, d = self.local_models(x, y)
        first, last = t.range
        low, _ = d.range
        c = np.zeros_like(x.c)
        rad = np.zeros_like(x.rad)
        lower = np.zeros_like(x.rad)
        upper = np.zeros_like(x.rad)
        for (start, end), atom in zip(self._contact, self._atoms, strict=True):
            at = np.flatnonzero((last >= 2 * start - end) & (first <= end) & (low <= end - start))
            if at.size:
                more = of(atom, x.on(at), y.on(at))
                c[:, at] += more.c
                rad[at] += more.rad + EPS * np.abs(c[:, at]).sum(axis=0)
                lower[at], upper[at] = interval.total((lower[at], upper[at]), more.range)
        return settled(x.basis, c, rad, (lower, upper))

    @cached_property
    def _atoms(self) -> list[Polar]:
        """The harmonic atoms of the contact intervals."""
        intervals = sorted(self.family.divided()[0])
        return [harmonic(self.polygon, self.side, float(a), self.alpha, number(b - a)) for a, b in intervals]

    def trace_and_flux(self, side: int, along: Along) -> tuple[Array, Array]:
        """(k,) values of u and of its outward normal derivative on the side."""
        index, length, theta, (v, _, v_theta, _) = self._parts(along.t, np.zeros_like(along.t))
        scale = length ** float(self.alpha)
        value = _summed(index, self.length * length * scale * v, along.t)
        return value, _summed(index, scale * np.where(theta > 0, v_theta, -v_theta), along.t)

    def kinks(self) -> list[Kink]:
        centres = self.centre + self._contact[:, :1] * self.length * self.frame[0]
        lengths = np.diff(self._contact)[:, 0] * self.length
        return [Kink((x, y), length) for (x, y), length in zip(centres.tolist(), lengths, strict=True)]

    def singular(self) -> list[Singular]:
        kinds = (self.alpha.denominator, 1)
        ends = self._contact.tolist()
        return [Singular(self.side, t, k) for pair in ends for t, k in zip(pair, kinds, strict=True)]
