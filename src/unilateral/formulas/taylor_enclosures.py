"""Elementary functions of Taylor models, and the formulas that are made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction

import numpy as np

from unilateral.arrays import Array
from unilateral.formulas import interval
from unilateral.formulas.exact_numbers import nearest
from unilateral.formulas.expression import Atom, Expression
from unilateral.formulas.formula_walk import Evaluation
from unilateral.formulas.interval import QUIET, Interval
from unilateral.formulas.taylor import (
    EPS,
    OF_FUNCTIONS,
    Model,
    by_part,
    composed,
    constant,
    number,
    series,
    settled,
    upward,
)

Function = Callable[[Model], Model]
Range = Callable[[Interval], Interval]
Steps = Mapping[Atom, Array]

OF_TANH = 1024 * EPS
"""The error of a Taylor coefficient of tanh.

Every step of the recursion at most doubles the error before it.
"""
AROUND_TANH = 1.5575
"""The largest |tanh| up to a distance of 1 from the real axis, tan 1 = 1.55740.., rounded up."""
OF_EXPONENT = 1e-10
"""More than the relative rounding of a power of x with an exponent up to 100, for |log x| < 745."""


def _around(a: Model) -> tuple[Array, Interval, int]:
    """The constant term of a model, an interval that contains it and all values, and the degree n."""
    at = a.c[0]
    return at, (np.fmin(a.range[0], at), np.fmax(a.range[1], at)), a.basis.order


def _factorials(n: int) -> Array:
    return np.array([float(math.factorial(k)) for k in range(n + 2)])[:, None]


def _entire(cycle: Callable[[Array], list[Array]], bound: Range | None, range_of: Range) -> Function:
    """A function whose derivatives at points (k,) repeat a `cycle`; `bound` is for all of them, else 1 is."""

    @QUIET
    def function(a: Model) -> Model:
        at, values, n = _around(a)
        fact = _factorials(n)
        derivatives = cycle(at)
        coefficients = np.stack([derivatives[k % len(derivatives)] for k in range(n + 1)]) / fact[:-1]
        if bound is None:  # sin and cos are accurate to a unit of 1, not relatively
            return composed(a, coefficients, 1 / fact[-1], range_of(a.range), error=4 * EPS)
        return composed(a, coefficients, bound(values)[1] / fact[-1], range_of(a.range))

    return function


def tanh(a: Model) -> Model:
    """tanh of a model, by y' = 1 - y^2 and Cauchy's estimate on circles of radius 1."""
    at, _, n = _around(a)
    y = np.zeros((n + 1, len(at)))
    y[0] = np.tanh(at)
    for k in range(n):
        y[k + 1] = ((k == 0) - np.sum(y[: k + 1] * y[k::-1], axis=0)) / (k + 1)
    return composed(a, y, AROUND_TANH + 0 * at, interval.tanh(a.range), OF_TANH)


def _binomials(exponent: float, n: int) -> Array:
    """(n + 2, 1) coefficients of (1 + z)^exponent."""
    coefficients = [1.0]
    for k in range(n + 1):
        coefficients.append(coefficients[-1] * (exponent - k) / (k + 1))
    return np.array(coefficients)[:, None]


@QUIET
def _power_series(a: Model, exponent: float, range_: Interval) -> Model:
    """The series of a^exponent where a > 0, or where a is not 0 and the exponent is whole and negative.

    Elsewhere it is the range of a^exponent. The exponent is negative or fractional, so that no coefficient
    is 0.
    """
    at, (low, high), n = _around(a)
    *binomials, next_ = _binomials(exponent, n)
    either_sign = exponent == int(exponent)
    coefficients = np.array(binomials) * at ** (exponent - np.arange(n + 1)[:, None])
    nearest = np.where(low > 0, low, -high if either_sign else np.nan)
    farthest = np.maximum(np.abs(low), np.abs(high))
    ends = [end ** (exponent - n - 1) for end in (nearest, farthest)]
    last = np.where(nearest > 0, np.abs(next_) * np.maximum(*ends), np.inf)
    # a fractional exponent is rounded, which counts log a times
    logs = 1 + np.abs(np.log(np.abs(at)))
    error = (OF_FUNCTIONS + 4 * EPS * (n + abs(exponent)) * logs) * np.abs(coefficients)
    return composed(a, coefficients, (1 + OF_EXPONENT) * last, range_, error)


def power(a: Model, n: int) -> Model:
    """a^n for a whole number n that is not 0."""
    values = interval.power(a.range, n)
    if n < 0:
        return _power_series(a, float(n), values)
    product = a
    for bit in bin(n)[3:]:
        product = product * product * a if bit == "1" else product * product
    return settled(product.basis, product.c, product.rad, values)


def root(a: Model, k: float) -> Model:
    """a^k for a k that is no whole number, where a > 0. Nothing is known where a may be 0 or negative."""
    positive = a.range[0] > 0
    lower, upper = interval.of_positive_part(a.range, k)
    return _power_series(a, k, (np.where(positive, lower, -np.inf), np.where(positive, upper, np.inf)))


def positive_power(a: Model, k: float) -> Model:
    """a_+^k for k != 0. Where a has both signs and a >= -d, it is a^k up to d^k for a whole k > 0.

    For any other k only its range is known there.
    """
    lower, upper = a.range
    whole = k > 0 and k == int(k)

    def of_positive(a: Model) -> Model:
        values = interval.of_positive_part(a.range, k)
        if not whole:
            return _power_series(a, k, values)
        whole_power = power(a, int(k))
        beyond = interval.of_positive_part((-a.range[1], -a.range[0]), k)[1]
        return settled(a.basis, whole_power.c, whole_power.rad + beyond, values)

    def of_both(a: Model) -> Model:
        return constant(a.basis, interval.of_positive_part(a.range, k))

    known = (lower > 0) | (whole & (upper > 0))
    return by_part([(of_positive, known), (of_both, (upper > 0) & ~known)], a)


@QUIET
def real_power(x: Model, y: Model, beta: float, phase: float, omega: float) -> Model:
    """r^beta cos(beta (theta - phase)) with x + i y = r exp(i theta), theta in [0, omega] and beta > 0.

    By the series of z^beta, z = x + i y, about the box's centre, which converges where |z| at the centre is
    larger than the box. From its term n + 1 on, each next term is at most `ratio` times as large.
    """
    n = x.basis.order
    turn = np.exp(-0.5j * omega)  # the branch's cut is then outside of Omega
    z = (x.c + 1j * y.c) * turn
    sizes = np.abs(x.c) + np.abs(y.c)
    rad = x.rad + y.rad + 4 * EPS * sizes.sum(axis=0)
    at = np.abs(z[0])
    reach = np.abs(z[1:]).sum(axis=0) + rad
    binomials = _binomials(beta, n)
    exponents = beta - np.arange(n + 1)[:, None]
    coefficients = binomials[:-1] * z[0] ** exponents * np.exp(1j * beta * (0.5 * omega - phase))
    error = 8 * EPS * np.abs(coefficients) * (1 + np.abs(exponents) * (4 + np.abs(np.log(at))))
    ratio = (1 + OF_EXPONENT) * max(1.0, (beta - n - 1) / (n + 2)) * reach / at
    last = np.where(ratio < 1, np.abs(binomials[-1]) * at ** (beta - n - 1) / (1 - ratio), np.inf)
    c, rad = series(x.basis, (z, rad), coefficients, (1 + OF_EXPONENT) * last, error)
    reach = upward(x.basis, at + reach)
    most = interval.of_positive_part((reach, reach), beta)[1]
    return settled(x.basis, c.real.copy(), rad, (-most, most))


FUNCTIONS: dict[str, Function] = {
    "exp": _entire(lambda a: [np.exp(a)], interval.exp, interval.exp),
    "sin": _entire(lambda a: [np.sin(a), np.cos(a), -np.sin(a), -np.cos(a)], None, interval.sin),
    "cos": _entire(lambda a: [np.cos(a), -np.sin(a), -np.cos(a), np.sin(a)], None, interval.cos),
    "sinh": _entire(lambda a: [np.sinh(a), np.cosh(a)], interval.cosh, interval.sinh),
    "cosh": _entire(lambda a: [np.cosh(a), np.sinh(a)], interval.cosh, interval.cosh),
    "tanh": tanh,
}


def evaluate(formula: Expression, variables: Mapping[str, Model], steps: Steps | None = None) -> Model:
    """A formula of the grammar, without logarithms, on the boxes of its variables' models.

    `steps` gives the value (k,) that a jump pos(a, 0) has on each box, NaN where it has both.
    """
    like = next(iter(variables.values()))
    known = {Atom(name): model for name, model in variables.items()}
    for step, value in (steps or {}).items():
        both = np.isnan(value)
        known[step] = constant(like.basis, (np.where(both, 0.0, value), np.where(both, 1.0, value)))
    return _Models((formula,), known).of(formula)


class _Models(Evaluation[Model]):
    def number(self, value: Fraction) -> Model:
        return number(next(iter(self.known.values())), float(value))

    def constant(self, e: Expression) -> Model:
        return number(next(iter(self.known.values())), nearest(e))

    def times(self, value: Model, e: Expression) -> Model:
        return value.scaled(nearest(e))

    def power(self, base: Model, k: Fraction) -> Model:
        return power(base, int(k)) if k.denominator == 1 else root(base, float(k))

    def function(self, of: Atom) -> Model:
        a = self.of(of.args[0])
        if of.name != "pos":
            return FUNCTIONS[of.name](a)
        k = nearest(of.args[1])
        return positive_power(a, k) if k else _step(a)


def _step(a: Model) -> Model:
    """pos(a, 0), which is 1 where a > 0 and 0 elsewhere, as a model."""
    low, high = a.range
    return constant(a.basis, (np.where(low > 0, 1.0, 0.0), np.where(high > 0, 1.0, 0.0)))
