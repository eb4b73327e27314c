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
from unilateral.formulas.expression import ONE, Expression, rational_expression, sum_terms
from unilateral.formulas.formula import CompiledFormulas, compile_numpy
from unilateral.formulas.taylor import EPS, TaylorModel, tighten_model
from unilateral.geometry.curves import Kink, SingularPoint
from unilateral.problems.atoms import Regularity, SideAtom, SidePoints, T
from unilateral.problems.polar_atoms import PolarAtom, make_harmonic_atom

ExactInterval = tuple[Fraction, Fraction]
UNREMOVED_GAP_FACTOR = Fraction(1, 100)
"""The gap on the intervals that are left is multiplied by this.

They are no part of the set, which has measure 0, and their gap must not outweigh that of the removed ones.
"""


class SupportPoints(NamedTuple):
    """The points in supports of atoms, by their numbers `point` (m,), one support after another.

    `length` is l, and `theta` the angle at the support's centre. v, dv/dr, (dv/dtheta)/r and Delta v are
    those of the atom whose contact is [0, 1], at r / l and theta.
    """

    point: Index
    length: Array
    theta: Array
    v: Array
    v_r: Array
    v_theta_over_r: Array
    laplacian: Array


class CantorSet(NamedTuple):
    """The set between t = inset and t = 1 - inset: the share kept at either end, and how many generations."""

    keep: Fraction
    generations: int
    inset: Fraction

    @property
    def dimension(self) -> float:
        """The dimension of the set that is not truncated."""
        return log(2) / log(1 / self.keep)

    def sobolev_order(self, power: Fraction) -> float:
        """A function that is like s^power on the removed intervals is in H^tau for every tau below this."""
        return float(power) + (1 - self.dimension) / 2

    def sort_intervals(self) -> tuple[list[ExactInterval], list[ExactInterval], list[ExactInterval]]:
        """The intervals that odd generations remove, that even ones remove, and that are left."""
        intervals: list[ExactInterval] = [(self.inset, 1 - self.inset)]
        removed: tuple[list[ExactInterval], list[ExactInterval]] = ([], [])
        for generation in range(self.generations):
            # [a, b] loses the middle [c, d] and keeps [a, c] and [d, b], `keep` of its length each
            inner = [(a + self.keep * (b - a), b - self.keep * (b - a)) for a, b in intervals]
            removed[generation % 2].extend(inner)
            intervals = [
                pair for (a, b), (c, d) in zip(intervals, inner, strict=True) for pair in ((a, c), (d, b))
            ]
        return *removed, intervals


def cantor_gap(cantor_set: CantorSet, gamma: Fraction) -> Expression:
    """u - g as a formula in t: ((t - c)(d - t)/(d - c))^gamma on what even generations remove.

    On what is left it is UNREMOVED_GAP_FACTOR times that. From the set's ends it grows like s^gamma to the
    vertices.
    """
    _, removed, intervals = cantor_set.sort_intervals()
    gaps = [pos(cantor_set.inset - T, gamma), pos(T - 1 + cantor_set.inset, gamma)]
    gaps += [pos((T - c) * (d - T), gamma) / rational_expression(d - c) ** gamma for c, d in removed]
    gaps += [
        UNREMOVED_GAP_FACTOR * pos((T - c) * (d - T), gamma) / rational_expression(d - c) ** gamma
        for c, d in intervals
    ]
    return sum_terms(term for gap in gaps for term in gap.terms)


def _sum_at_points(index: Index, values: Array, points: Array) -> Array:
    """The values (m,) added up at the points whose numbers are `index` (m,), (k,)."""
    return np.bincount(index, values, len(points)).astype(float, copy=False)


@dataclass(frozen=True, eq=False)
class CantorAtom(SideAtom):
    """The atom on a side; its place t is the side's start."""

    cantor_set: CantorSet
    alpha: Fraction

    @property
    def flux_order(self) -> float:
        """lambda is in H^sigma on the side for every sigma below this."""
        return self.cantor_set.sobolev_order(self.alpha)

    @property
    def regularity(self) -> Regularity:
        """The regularity of u and lambda, from alpha and the dimension of the set."""
        # lambda in H^s: u is in H^2 for an s >= 1/2; lambda ~ s^alpha is bounded for alpha >= 0
        bounded = self.alpha >= 0
        order = self.flux_order
        return Regularity(order > 1 / 2, bounded, order > 0, bounded, finite=False)

    @cached_property
    def _contact_intervals(self) -> Array:
        """Ends of the contact intervals, (k, 2)."""
        return np.array(sorted(self.cantor_set.sort_intervals()[0]), dtype=float)

    @cached_property
    def _unit_atom(self) -> CompiledFormulas:
        """v, dv/dr, (dv/dtheta)/r and Delta v of the atom whose contact is [0, 1], in r and theta."""
        atom = make_harmonic_atom(self.polygon, self.side, 0.0, self.alpha, cutoff=ONE)
        return compile_numpy(atom.derivatives, ("r", "theta"))

    def _evaluate_in_supports(self, along: Array, into: Array) -> SupportPoints:
        """The points that lie in supports, by their coordinates along the side and into Omega, (k,) each."""
        # A support is the half disc of radius l about a start; `near` are the points below the largest l
        starts = self._contact_intervals[:, 0]
        lengths = np.diff(self._contact_intervals)[:, 0]
        near = np.flatnonzero(into < lengths.max())
        near = near[np.argsort(along[near], kind="stable")]
        # Those with start - l <= along < start + l, support by support; a point may lie in several
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
        return SupportPoints(points[inside], length, theta, *self._unit_atom(r[inside] / length, theta))

    def value_and_gradient(self, points: Array, offset: Array | float = 0.0) -> tuple[Array, Array]:
        """Values (k,) and gradients (k, 2) at points + offset."""
        return self.value_gradient_and_source(points, offset)[:2]

    def value_gradient_and_source(
        self, points: Array, offset: Array | float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Values, gradients and values of -Delta u + u at points + offset."""
        along, into = self.local_coordinates_inside(points, offset)
        support = self._evaluate_in_supports(along, into)
        # An atom on an interval of length l (in units of L) is L l l^alpha v(r / l): lambda is like s^alpha
        scale = support.length ** float(self.alpha)
        size = self.length * support.length
        slopes = self.rotate_polar_to_xy(support.theta, scale * support.v_r, scale * support.v_theta_over_r).T
        value = _sum_at_points(support.point, size * scale * support.v, along)
        gradient = np.column_stack([_sum_at_points(support.point, slope, along) for slope in slopes])
        f = _sum_at_points(support.point, scale * (size * support.v - support.laplacian / size), along)
        return value, gradient, f

    def vanishes_in_circles(self, centre: Array, radius: Array) -> Mask:
        """Whether u is known to be 0 in each circle, (k,)."""
        return (
            self.local_coordinates(centre)[1] - radius / self.length > np.diff(self._contact_intervals).max()
        )

    def value_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """The model of u on the boxes of x and y."""
        return self._sum_models(PolarAtom.value_model, x, y)

    def source_model(self, x: TaylorModel, y: TaylorModel) -> TaylorModel:
        """The model of -Delta u + u on the boxes of x and y."""
        return self._sum_models(PolarAtom.source_model, x, y)

    def _sum_models(
        self,
        enclose: Callable[[PolarAtom, TaylorModel, TaylorModel], TaylorModel],
        x: TaylorModel,
        y: TaylorModel,
    ) -> TaylorModel:
        """The sum over the atoms, each on the boxes that may meet its support."""
        t, d = self.local_models(x, y)
        first, last = t.range
        low, _ = d.range
        c = np.zeros_like(x.c)
        rad = np.zeros_like(x.rad)
        lower = np.zeros_like(x.rad)
        upper = np.zeros_like(x.rad)
        for (start, end), atom in zip(self._contact_intervals, self._atoms, strict=True):
            # the boxes that may meet [start - l, start + l] x [0, l], l = end - start
            boxes = np.flatnonzero((last >= 2 * start - end) & (first <= end) & (low <= end - start))
            if boxes.size:
                model = enclose(atom, x.select_boxes(boxes), y.select_boxes(boxes))
                c[:, boxes] += model.c
                # and the rounding of the sum
                rad[boxes] += model.rad + EPS * np.abs(c[:, boxes]).sum(axis=0)
                lower[boxes], upper[boxes] = interval.add_intervals((lower[boxes], upper[boxes]), model.range)
        return tighten_model(x.basis, c, rad, (lower, upper))

    @cached_property
    def _atoms(self) -> list[PolarAtom]:
        """The harmonic atoms of the contact intervals."""
        intervals = sorted(self.cantor_set.sort_intervals()[0])
        return [
            make_harmonic_atom(self.polygon, self.side, float(a), self.alpha, rational_expression(b - a))
            for a, b in intervals
        ]

    def trace_and_normal_flux(self, side: int, along: SidePoints) -> tuple[Array, Array]:
        """Values of u and of its outward normal derivative on the side, (k,) each."""
        support = self._evaluate_in_supports(along.t, np.zeros_like(along.t))
        scale = support.length ** float(self.alpha)
        value = _sum_at_points(support.point, self.length * support.length * scale * support.v, along.t)
        # du/dn = -(dv/dtheta)/r for theta = 0 and +(dv/dtheta)/r for theta = pi
        flux = scale * np.where(support.theta > 0, support.v_theta_over_r, -support.v_theta_over_r)
        return value, _sum_at_points(support.point, flux, along.t)

    def kinks(self) -> list[Kink]:
        """The circles about the starts of the contact intervals at which cutoffs end."""
        centres = self.centre + self._contact_intervals[:, :1] * self.length * self.frame[0]
        lengths = np.diff(self._contact_intervals)[:, 0] * self.length
        return [Kink((x, y), length) for (x, y), length in zip(centres.tolist(), lengths, strict=True)]

    def singular_points(self) -> list[SingularPoint]:
        """The ends of the contact intervals."""
        kinds = (self.alpha.denominator, 1)
        ends = self._contact_intervals.tolist()
        return [SingularPoint(self.side, t, k) for pair in ends for t, k in zip(pair, kinds, strict=True)]
