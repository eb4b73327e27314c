"""Taylor models: functions on many boxes at once, each a polynomial with a guaranteed remainder.

On box j the variables are affine functions of sigma in [-1, 1]^d. A model says of a function F on it

    |F - sum over alpha of c_alpha sigma^alpha| <= rad  and  lower <= F <= upper,

with |alpha| <= n (Makino and Berz, 2003). `rad` includes rounding, and the range is rounded outward. A
polynomial that is not sharper than the range is replaced by the range's midpoint, and so is one that
overflows. Therefore a model has only a range at kinks and singularities. EPS is twice a bound on the
rounding of one operation; UNDERFLOW_ALLOWANCE is added wherever numbers may underflow. Coefficients are
finite, and `rad` is infinite where nothing is known (`tighten_model`).
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
from unilateral.formulas.interval import QUIET, IntervalArrays

EPS = 2.0**-52
UNDERFLOW_ALLOWANCE = 1e-300
"""More than all that underflows in the operations that make a coefficient, each at most 2^-1022."""
FUNCTION_COEFFICIENT_ERROR = 8 * EPS
"""The relative error of a Taylor coefficient of a function."""


class MonomialBasis(NamedTuple):
    """The monomials up to degree n, in the order of their `degrees` (m,), with their `exponents` (m, d).

    `degree_starts` (n + 2,) is where each degree begins. For each monomial `product_slices` has those whose
    product with it is of degree at most n, and the numbers of these products, both as slices of neighbours.
    """

    exponents: Index
    degrees: Index
    degree_starts: Index
    product_slices: tuple[tuple[tuple[slice, slice], ...], ...]

    @property
    def order(self) -> int:
        """The highest degree n."""
        return len(self.degree_starts) - 2


@cache
def monomial_basis(d: int, n: int) -> MonomialBasis:
    """The basis for d variables up to degree n."""
    alphas = sorted((a for a in cartesian(range(n + 1), repeat=d) if sum(a) <= n), key=lambda a: (sum(a), a))
    exponents = np.array(alphas, dtype=np.intp)
    degree = exponents.sum(axis=1)
    place = {a: i for i, a in enumerate(alphas)}
    first = np.searchsorted(degree, np.arange(n + 2))
    # sigma^a sigma^b = sigma^(a + b) for all b of degree at most n - |a|, which come first
    slices = []
    for a in alphas:
        sums = exponents[: first[n - sum(a) + 1]] + np.array(a)
        slices.append(_runs_of_neighbours(np.array([place[tuple(b)] for b in sums.tolist()])))
    return MonomialBasis(exponents, degree, first, tuple(slices))


def _runs_of_neighbours(places: Index) -> tuple[tuple[slice, slice], ...]:
    """Slices of the indices 0, 1, ... and of their places (k,), cut where a place is not the next one."""
    cuts = [0, *(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
    return tuple(
        (slice(i, j), slice(place, place + j - i))
        for (i, j), place in zip(pairwise(cuts), places[cuts[:-1]].tolist(), strict=True)
    )


@dataclass(frozen=True, eq=False)
class TaylorModel:
    """A model on k boxes: coefficients c (m, k), remainder rad (k,), and the range, two arrays (k,)."""

    basis: MonomialBasis
    c: Array
    rad: Array
    range: IntervalArrays

    @QUIET
    def __add__(self, model: TaylorModel) -> TaylorModel:
        # Remainders add, and each sum of two coefficients is rounded by EPS times both
        c = self.c + model.c
        rad = self.rad + model.rad + EPS * (np.abs(self.c) + np.abs(model.c)).sum(axis=0)
        return tighten_model(self.basis, c, rad, interval.add_intervals(self.range, model.range))

    def __mul__(self, model: TaylorModel) -> TaylorModel:
        c, rad = _multiply_models(self.basis, (self.c, self.rad), (model.c, model.rad))
        return tighten_model(self.basis, c, rad, interval.multiply_intervals(self.range, model.range))

    @QUIET
    def scale(self, number: float) -> TaylorModel:
        """The model times a number that is rounded, and may be subnormal or infinite then."""
        # The number is off by EPS of itself, or by underflow, which counts all that it multiplies
        sizes = np.abs(self.c).sum(axis=0)
        number_error = 4 * EPS * abs(number) + UNDERFLOW_ALLOWANCE
        rad = (1 + EPS) * abs(number) * self.rad + number_error * (sizes + self.rad)
        factor = np.array([number])
        values = interval.multiply_intervals(self.range, interval.round_outward(factor, factor))
        return tighten_model(self.basis, number * self.c, rad, values)

    def select_boxes(self, boxes: Index | Mask) -> TaylorModel:
        """The model on some of the boxes, by a mask or an index."""
        lower, upper = self.range
        return TaylorModel(self.basis, self.c[:, boxes], self.rad[boxes], (lower[boxes], upper[boxes]))


@QUIET
def affine_model(
    basis: MonomialBasis, centre: Array, half_widths: Array, ends: IntervalArrays, rounding: float = 0.0
) -> TaylorModel:
    """The model of `centre` (k,) + sum over i of `half_widths` (d, k) times sigma_i, with the range `ends`.

    The remainder covers the rounding of these numbers and the further `rounding`.
    """
    c = np.zeros((len(basis.degrees), len(centre)))
    c[0] = centre
    c[basis.degree_starts[1] : basis.degree_starts[2]] = half_widths[::-1]  # of degree 1: (0, 1), (1, 0)
    rad = 4 * EPS * np.abs(c).sum(axis=0) + rounding + UNDERFLOW_ALLOWANCE
    return tighten_model(basis, c, rad, interval.round_outward(*ends))


def range_model(basis: MonomialBasis, values: IntervalArrays) -> TaylorModel:
    """The model of a function of which only two bounds (k,) are known."""
    bounds = np.fmax(values[0], -np.inf), np.fmin(values[1], np.inf)
    c = np.zeros((len(basis.degrees), len(bounds[0])))
    c[0], rad = _midpoint_and_radius(bounds)
    return TaylorModel(basis, c, rad, bounds)


def number_model(model: TaylorModel, value: Array | float) -> TaylorModel:
    """The model of a rounded number, or of one per box (k,), on the boxes of another model."""
    values = value + np.zeros_like(model.rad)
    return range_model(model.basis, interval.round_outward(values, values))


def join_models(pieces: Sequence[tuple[TaylorModel, Index]]) -> TaylorModel:
    """One model of all boxes from those on parts of them, each with its index."""
    models, places = zip(*pieces, strict=True)
    order = np.argsort(np.concatenate(places))
    c = np.concatenate([m.c for m in models], axis=1)[:, order]
    rad = np.concatenate([m.rad for m in models])[order]
    lower = np.concatenate([m.range[0] for m in models])[order]
    upper = np.concatenate([m.range[1] for m in models])[order]
    return TaylorModel(models[0].basis, c, rad, (lower, upper))


def apply_on_subsets(
    pieces: Sequence[tuple[Callable[..., TaylorModel], Mask]], *arguments: TaylorModel
) -> TaylorModel:
    """Functions of models, each on its part of the boxes, and 0 on the rest; the parts are disjoint."""
    done = []
    outside = np.ones(len(arguments[0].rad), dtype=bool)
    for function, where in pieces:
        outside &= ~where
        if where.all():
            return function(*arguments)
        if where.any():
            selected = [argument.select_boxes(where) for argument in arguments]
            done.append((function(*selected), np.flatnonzero(where)))
    zero = number_model(arguments[0].select_boxes(outside), 0.0)
    return join_models([*done, (zero, np.flatnonzero(outside))])


@QUIET
def tighten_model(basis: MonomialBasis, c: Array, rad: Array, values: IntervalArrays) -> TaylorModel:
    """The model, its range cut to what the polynomial allows.

    A polynomial that is then not sharper than the range is replaced by the range's midpoint, and so is one
    that is not finite or not known to be near the function, whatever became of its remainder.
    """
    # |F - c_0| <= sum over alpha != 0 of |c_alpha| + rad, for |sigma_i| <= 1
    rad = add_rounding(basis, rad)
    reach = add_rounding(basis, np.abs(c[1:]).sum(axis=0) + rad)
    low = c[0] - reach
    high = c[0] + reach
    lower, upper = interval.round_outward(low, high)
    finite = np.isfinite(low) & np.isfinite(high)
    if not finite.all():
        lower = np.where(finite, lower, -np.inf)
        upper = np.where(finite, upper, np.inf)
    lower = np.fmax(lower, values[0])
    upper = np.fmin(upper, values[1])
    # The range's midpoint is off by half its width: as good as a polynomial with that remainder
    flat = ~(finite & (rad <= 0.5 * upper - 0.5 * lower))
    if flat.any():
        c = np.where(flat, 0.0, c)
        (middle, half) = _midpoint_and_radius((lower, upper))
        c[0] = np.where(flat, middle, c[0])
        rad = np.where(flat, half, rad)
    return TaylorModel(basis, c, rad, (lower, upper))


def add_rounding(basis: MonomialBasis, size: Array) -> Array:
    """Sizes increased by what rounding of their sums and products, one per monomial, may take away, (k,)."""
    return (1 + 4 * len(basis.degrees) * EPS) * size + UNDERFLOW_ALLOWANCE


@QUIET
def _midpoint_and_radius(values: IntervalArrays) -> tuple[Array, Array]:
    """The midpoints (k,) of intervals and how far they reach from there; 0 and inf where there is none."""
    lower, upper = values
    middle = 0.5 * upper + 0.5 * lower
    half = 0.5 * upper - 0.5 * lower
    finite = np.isfinite(middle)
    reach = (1 + 4 * EPS) * (half + EPS * np.abs(middle)) + UNDERFLOW_ALLOWANCE
    return np.where(finite, middle, 0.0), np.where(finite, reach, np.inf)


def _sizes_by_degree(basis: MonomialBasis, c: Array) -> Array:
    """Sums of |c_alpha| over the monomials of each degree, (n + 1, k)."""
    sizes = np.abs(c, order="C")  # sums of many rows are rounded by their order in memory
    if len(basis.degrees) == basis.order + 1:  # of one variable there is one monomial of each degree
        return sizes
    sums = sizes[basis.degree_starts[:-1]]
    for degree, (i, j) in enumerate(pairwise(basis.degree_starts.tolist())):
        if j - i > 1:
            sums[degree] += np.add.reduce(sizes[i + 1 : j])
    return sums


@QUIET
def _multiply_models(
    basis: MonomialBasis, a: tuple[Array, Array], b: tuple[Array, Array]
) -> tuple[Array, Array]:
    """The coefficients and the remainder of a product."""
    # (x + r)(y + s) = x y + (x + r) s + r y; of x y the products of degree up to n are kept
    (x, r) = a
    (y, s) = b
    c = np.zeros(x.shape, dtype=np.result_type(x, y))
    for i in np.flatnonzero(x.any(axis=1)):
        for factors, products in basis.product_slices[i]:
            c[products] += x[i] * y[factors]
    x_sizes = _sizes_by_degree(basis, x)
    # y_tails[i] is the sum over the degrees of y from n - i on, whose products with degree i + 1 are left out
    y_tails = np.add.accumulate(_sizes_by_degree(basis, y)[::-1])
    above = np.add.reduce(x_sizes[1:] * y_tails[:-1])
    x_size = np.add.reduce(x_sizes)
    y_size = y_tails[-1]
    rounding = (len(basis.degrees) + 2) * EPS * (x_size * y_size)  # EPS times one of them may underflow
    return c, add_rounding(basis, above + (x_size + r) * s + y_size * r + rounding)


def compose_model(
    a: TaylorModel,
    coefficients: Array,
    next_bound: Array,
    values: IntervalArrays,
    error: Array | float | None = None,
) -> TaylorModel:
    """g(a) from g's Taylor coefficients (n + 1, k) at a's constant term, and bounds (k,) on the next.

    `next_bound` bounds |g^(n+1)| / (n+1)! on all values of a and their constant term, up to underflow.
    It may be a quotient rounded to nearest, for what it is multiplied by is rounded up. `error` is that of
    the coefficients, by default FUNCTION_COEFFICIENT_ERROR times their size. `values` is the range of g(a).
    """
    c, rad = compose_coefficients(a.basis, (a.c, a.rad), coefficients, next_bound, error)
    return tighten_model(a.basis, c, rad, values)


@QUIET
def compose_coefficients(
    basis: MonomialBasis,
    a: tuple[Array, Array],
    coefficients: Array,
    next_bound: Array,
    error: Array | float | None = None,
) -> tuple[Array, Array]:
    """The coefficients, which may be complex, and the remainder of g(a) as in `compose_model`."""
    # g(a) = sum over k <= n of g_k (a - a_0)^k by Horner's rule, and the rest: next_bound |a - a_0|^(n + 1).
    # (inner, a[1]) is a - a_0, of at most this size
    inner = a[0].copy()
    inner[0] = 0.0
    size = add_rounding(basis, np.abs(inner).sum(axis=0) + a[1])
    sizes = np.abs(coefficients)
    errors = (
        EPS * sizes + (FUNCTION_COEFFICIENT_ERROR * sizes if error is None else error) + UNDERFLOW_ALLOWANCE
    )
    c = np.zeros_like(inner, dtype=np.result_type(inner, coefficients))
    rad = np.zeros(len(size))
    # rad has the remainders of the products; `beyond` bounds the rest and the errors of the g_k
    c[0] = coefficients[-1]
    beyond = (next_bound + UNDERFLOW_ALLOWANCE) * size + errors[-1]
    for g, e in zip(coefficients[-2::-1], errors[-2::-1], strict=True):
        c, rad = _multiply_models(basis, (c, rad), (inner, a[1]))
        c[0] += g
        beyond = beyond * size + e  # not by powers of the size, which may underflow
    return c, rad + beyond
