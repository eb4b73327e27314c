"""Taylor models: functions on many boxes at once, each a polynomial with a guaranteed remainder.

On box j the variables are affine functions of sigma in [-1, 1]^d. A model says of a function F on it

    |F - sum over alpha of c_alpha sigma^alpha| <= rad  and  lower <= F <= upper,

with |alpha| <= n (Makino and Berz, 2003). `rad` includes rounding, and the range is rounded outward. A
polynomial that is not sharper than the range is replaced by the range's midpoint, and so is one that
overflows. Therefore a model has only a range at kinks and singularities. EPS is twice a bound on the
rounding of one operation, and TINY is added wherever numbers may underflow. Coefficients are finite, and
`rad` is infinite where nothing is known (`settled`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from itertools import product as cartesian
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas import interval
from unilateral.formulas.interval import QUIET, Interval

EPS = 2.0**-52
TINY = 1e-300
"""More than all that underflows in the operations that make a coefficient, each at most 2^-1022."""
OF_FUNCTIONS = 8 * EPS
"""The relative error of a Taylor coefficient of a function."""


class Basis(NamedTuple):
    """The monomials up to degree n, in the order of their `degree` (m,), with their `exponents` (m, d).

    `first` (n + 2,) is where each degree begins. For each monomial `times` has those whose product with it
    is of degree at most n, and the numbers of these products, both as slices of neighbours.
    """

    exponents: Index
    degree: Index
    first: Index
    times: tuple[tuple[tuple[slice, slice], ...], ...]

    @property
    def order(self) -> int:
        return len(self.first) - 2


@cache
def basis(d: int, n: int) -> Basis:
    """The basis for d variables up to degree n."""
    alphas = sorted((a for a in cartesian(range(n + 1), repeat=d) if sum(a) <= n), key=lambda a: (sum(a), a))
    exponents = np.array(alphas, dtype=np.intp)
    degree = exponents.sum(axis=1)
    place = {a: i for i, a in enumerate(alphas)}
    first = np.searchsorted(degree, np.arange(n + 2))
    times = []
    for a in alphas:
        sums = exponents[: first[n - sum(a) + 1]] + np.array(a)
        times.append(_runs(np.array([place[tuple(b)] for b in sums.tolist()])))
    return Basis(exponents, degree, first, tuple(times))


def _runs(places: Index) -> tuple[tuple[slice, slice], ...]:
    """Slices of the indices 0, 1, ... and of their places (k,), cut where a place is not the next one."""
    cuts = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return tuple(
        (slice(i, j), slice(at, at + j - i))
        for (i, j), at in zip(pairwise(cuts), places[cuts[:-1]].tolist(), strict=True)
    )


@dataclass(frozen=True, eq=False)
class Model:
    """A model on k boxes: coefficients c (m, k), remainder rad (k,), and the range, two arrays (k,)."""

    basis: Basis
    c: Array
    rad: Array
    range: Interval

    @QUIET
    def __add__(self, other: Model) -> Model:
        c = self.c + other.c
        rad = self.rad + other.rad + EPS * (np.abs(self.c) + np.abs(other.c)).sum(axis=0)
        return settled(self.basis, c, rad, interval.total(self.range, other.range))

    def __mul__(self, other: Model) -> Model:
        c, rad = _product(self.basis, (self.c, self.rad), (other.c, other.rad))
        return settled(self.basis, c, rad, interval.product(self.range, other.range))

    @QUIET
    def scaled(self, number: float) -> Model:
        """The model times a number that is rounded, and may be subnormal or infinite then."""
        sizes = np.abs(self.c).sum(axis=0)
        doubt = 4 * EPS * abs(number) + TINY
        rad = (1 + EPS) * abs(number) * self.rad + doubt * (sizes + self.rad)
        values = interval.product(self.range, interval.outward(np.array([number]), np.array([number])))
        return settled(self.basis, number * self.c, rad, values)

    def on(self, boxes: Index | Mask) -> Model:
        """The model on some of the boxes, by a mask or an index."""
        return Model(
            self.basis, self.c[:, boxes], self.rad[boxes], (self.range[0][boxes], self.range[1][boxes])
        )


@QUIET
def affine(of: Basis, centre: Array, arms: Array, ends: Interval, rounding: float = 0.0) -> Model:
    """centre (k,) + sum over i of arms (d, k) sigma_i, with the range `ends`.

    The remainder covers the rounding of these numbers and the further `rounding`.
    """
    c = np.zeros((len(of.degree), len(centre)))
    c[0] = centre
    c[of.first[1] : of.first[2]] = arms[::-1]  # of degree 1: (0, 1), (1, 0)
    return settled(of, c, 4 * EPS * np.abs(c).sum(axis=0) + rounding + TINY, interval.outward(*ends))


def constant(of: Basis, values: Interval) -> Model:
    """The model of a function of which only two bounds (k,) are known."""
    known = np.fmax(values[0], -np.inf), np.fmin(values[1], np.inf)
    c = np.zeros((len(of.degree), len(known[0])))
    c[0], rad = _middle(known)
    return Model(of, c, rad, known)


def number(like: Model, value: Array | float) -> Model:
    """The model of a rounded number, or of one per box (k,), on the boxes of another model."""
    values = value + np.zeros_like(like.rad)
    return constant(like.basis, interval.outward(values, values))


def joined(parts: Sequence[tuple[Model, Index]]) -> Model:
    """One model of all boxes from those on parts of them, each with its index."""
    models, places = zip(*parts, strict=True)
    order = np.argsort(np.concatenate(places))
    c = np.concatenate([m.c for m in models], axis=1)[:, order]
    rad = np.concatenate([m.rad for m in models])[order]
    lower = np.concatenate([m.range[0] for m in models])[order]
    upper = np.concatenate([m.range[1] for m in models])[order]
    return Model(models[0].basis, c, rad, (lower, upper))


def by_part(parts: Sequence[tuple[Callable[..., Model], Mask]], *arguments: Model) -> Model:
    """Functions of models, each on its part of the boxes, and 0 on the rest."""
    done = []
    rest = np.ones(len(arguments[0].rad), dtype=bool)
    for of, where in parts:
        rest &= ~where
        if where.all():
            return of(*arguments)
        if where.any():
            done.append((of(*(argument.on(where) for argument in arguments)), np.flatnonzero(where)))
    zero = number(arguments[0].on(rest), 0.0)
    return joined([*done, (zero, np.flatnonzero(rest))])


@QUIET
def settled(of: Basis, c: Array, rad: Array, range_: Interval) -> Model:
    """The model, its range cut to what the polynomial allows.

    A polynomial that is then not sharper than the range is replaced by the range's midpoint, and so is one
    that is not finite or not known to be near the function, whatever became of its remainder.
    """
    rad = upward(of, rad)
    reach = upward(of, np.abs(c[1:]).sum(axis=0) + rad)
    ends = c[0] - reach, c[0] + reach
    lower, upper = interval.outward(*ends)
    finite = np.isfinite(ends[0]) & np.isfinite(ends[1])
    if not finite.all():
        lower = np.where(finite, lower, -np.inf)
        upper = np.where(finite, upper, np.inf)
    lower = np.fmax(lower, range_[0])
    upper = np.fmin(upper, range_[1])
    flat = ~(finite & (rad <= 0.5 * upper - 0.5 * lower))
    if flat.any():
        c = np.where(flat, 0.0, c)
        (middle, half) = _middle((lower, upper))
        c[0] = np.where(flat, middle, c[0])
        rad = np.where(flat, half, rad)
    return Model(of, c, rad, (lower, upper))


def upward(of: Basis, size: Array) -> Array:
    """(k,) sizes, increased by what rounding of their sums and products, one per monomial, may take away."""
    return (1 + 4 * len(of.degree) * EPS) * size + TINY


@QUIET
def _middle(values: Interval) -> tuple[Array, Array]:
    """The midpoints (k,) of intervals and how far they reach from there; 0 and inf where there is none."""
    lower, upper = values
    middle = 0.5 * upper + 0.5 * lower
    half = 0.5 * upper - 0.5 * lower
    known = np.isfinite(middle)
    reach = (1 + 4 * EPS) * (half + EPS * np.abs(middle)) + TINY
    return np.where(known, middle, 0.0), np.where(known, reach, np.inf)


def _by_degree(of: Basis, c: Array) -> Array:
    """(n + 1, k) sums of |c_alpha| over the monomials of each degree."""
    sizes = np.abs(c, order="C")  # sums of many rows are rounded by their order in memory
    if len(of.degree) == of.order + 1:  # of one variable there is one monomial of each degree
        return sizes
    sums = sizes[of.first[:-1]]
    for degree, (i, j) in enumerate(pairwise(of.first.tolist())):
        if j - i > 1:
            sums[degree] += np.add.reduce(sizes[i + 1 : j])
    return sums


@QUIET
def _product(of: Basis, a: tuple[Array, Array], b: tuple[Array, Array]) -> tuple[Array, Array]:
    """The coefficients and the remainder of a product."""
    (x, r) = a
    (y, s) = b
    c = np.zeros(x.shape, dtype=np.result_type(x, y))
    for i in np.flatnonzero(x.any(axis=1)):
        for others, into in of.times[i]:
            c[into] += x[i] * y[others]
    of_x = _by_degree(of, x)
    # from_y[i] is the sum over the degrees of y from n - i on, whose products with degree i + 1 are left out
    from_y = np.add.accumulate(_by_degree(of, y)[::-1])
    above = np.add.reduce(of_x[1:] * from_y[:-1])
    all_x = np.add.reduce(of_x)
    all_y = from_y[-1]
    rounding = (len(of.degree) + 2) * EPS * (all_x * all_y)  # EPS times one of them may underflow
    return c, upward(of, above + (all_x + r) * s + all_y * r + rounding)


def composed(
    a: Model, coefficients: Array, last: Array, range_: Interval, error: Array | float | None = None
) -> Model:
    """g(a) from g's Taylor coefficients (n + 1, k) at a's constant term, and bounds (k,) on the next.

    `last` bounds |g^(n+1)| / (n+1)! on all values of a and their constant term, up to underflow. `error` is
    that of the coefficients, by default OF_FUNCTIONS times their size. `range_` is the range of g(a).
    """
    c, rad = series(a.basis, (a.c, a.rad), coefficients, last, error)
    return settled(a.basis, c, rad, range_)


@QUIET
def series(
    of: Basis, a: tuple[Array, Array], coefficients: Array, last: Array, error: Array | float | None = None
) -> tuple[Array, Array]:
    """The coefficients, which may be complex, and the remainder of g(a) as in `composed`."""
    inner = a[0].copy()
    inner[0] = 0.0
    size = upward(of, np.abs(inner).sum(axis=0) + a[1])
    sizes = np.abs(coefficients)
    errors = EPS * sizes + (OF_FUNCTIONS * sizes if error is None else error) + TINY
    c = np.zeros_like(inner, dtype=np.result_type(inner, coefficients))
    rad = np.zeros(len(size))
    c[0] = coefficients[-1]
    beyond = (last + TINY) * size + errors[-1]
    for g, e in zip(coefficients[-2::-1], errors[-2::-1], strict=True):
        c, rad = _product(of, (c, rad), (inner, a[1]))
        c[0] += g
        beyond = beyond * size + e  # not by powers of the size, which may underflow
    return c, rad + beyond
