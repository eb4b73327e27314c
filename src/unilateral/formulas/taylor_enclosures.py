"""Elementary functions of Taylor models, and the formulas that are made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from fractions import Fraction

import numpy as np

from unilateral.arrays import Array
from unilateral.formulas import interval
from unilateral.formulas.exact_numbers import as_float_or_inf
from unilateral.formulas.expression import Expression, Primitive
from unilateral.formulas.formula_walk import Evaluation
from unilateral.formulas.interval import QUIET, IntervalArrays
from unilateral.formulas.taylor import (
    EPS,
    FUNCTION_COEFFICIENT_ERROR,
    TaylorModel,
    add_rounding,
    apply_on_subsets,
    compose_coefficients,
    compose_model,
    number_model,
    range_model,
    tighten_model,
)

ModelFunction = Callable[[TaylorModel], TaylorModel]
IntervalFunction = Callable[[IntervalArrays], IntervalArrays]
StepValues = Mapping[Primitive, Array]

TANH_COEFFICIENT_ERROR = 1024 * EPS
"""The error of a Taylor coefficient of tanh: every step of the recursion at most doubles it."""
MAX_TANH_ON_CIRCLE = 1.5575
"""The largest |tanh| up to a distance of 1 from the real axis, tan 1 = 1.55740.., rounded up."""
POWER_ERROR = 1e-10
"""More than the relative rounding of a power of x with an exponent up to 100, for |log x| < 745."""


def _expansion_point(a: TaylorModel) -> tuple[Array, IntervalArrays, int]:
    """The constant term of a model, an interval that contains it and all values, and the degree n."""
    centre = a.c[0]
    return centre, (np.fmin(a.range[0], centre), np.fmax(a.range[1], centre)), a.basis.order


def _factorials(n: int) -> Array:
    """0! to (n + 1)!, (n + 2, 1)."""
    return np.array([float(math.factorial(k)) for k in range(n + 2)])[:, None]


def _make_entire_function(
    cycle: Callable[[Array], list[Array]], bound: IntervalFunction | None, interval_function: IntervalFunction
) -> ModelFunction:
    """An entire function: its derivatives at points (k,) repeat a `cycle`.

    Their sizes on an interval are at most the upper end of `bound`, by default 1.
    """

    @QUIET
    def evaluate(a: TaylorModel) -> TaylorModel:
        """The function of a model, by its Taylor polynomial at the model's constant term."""
        centre, values, n = _expansion_point(a)
        factorials = _factorials(n)
        derivatives = cycle(centre)
        coefficients = np.stack([derivatives[k % len(derivatives)] for k in range(n + 1)]) / factorials[:-1]
        image = interval_function(a.range)
        # compose_model rounds up what it multiplies the bound by, so a quotient may be rounded to nearest
        if bound is None:  # sin and cos are accurate to a unit of 1, not relatively
            return compose_model(a, coefficients, 1 / factorials[-1], image, error=4 * EPS)
        return compose_model(a, coefficients, bound(values)[1] / factorials[-1], image)

    return evaluate


def tanh_model(a: TaylorModel) -> TaylorModel:
    """tanh of a model, by y' = 1 - y^2 and Cauchy's estimate on circles of radius 1."""
    centre, _, n = _expansion_point(a)
    # (k + 1) y_(k + 1) = [k = 0] - sum over i of y_i y_(k - i)
    y = np.zeros((n + 1, len(centre)))
    y[0] = np.tanh(centre)
    for k in range(n):
        y[k + 1] = ((k == 0) - np.sum(y[: k + 1] * y[k::-1], axis=0)) / (k + 1)
    # Cauchy: |tanh^(n + 1)| / (n + 1)! <= max |tanh| on the circle / radius^(n + 1), about any real point
    next_bound = MAX_TANH_ON_CIRCLE + 0 * centre
    return compose_model(a, y, next_bound, interval.tanh(a.range), TANH_COEFFICIENT_ERROR)


def _binomial_coefficients(exponent: float, n: int) -> Array:
    """The coefficients of (1 + z)^exponent, (n + 2, 1)."""
    # (m over k + 1) = (m over k) (m - k) / (k + 1)
    coefficients = [1.0]
    for k in range(n + 1):
        coefficients.append(coefficients[-1] * (exponent - k) / (k + 1))
    return np.array(coefficients)[:, None]


@QUIET
def _power_series(a: TaylorModel, exponent: float, values: IntervalArrays) -> TaylorModel:
    """The series of a^exponent where a > 0, or where a is not 0 and the exponent is whole and negative.

    Elsewhere it is the range of a^exponent. The exponent is negative or fractional, so that no coefficient
    is 0.
    """
    centre, (low, high), n = _expansion_point(a)
    *binomials, next_ = _binomial_coefficients(exponent, n)
    either_sign = exponent == int(exponent)
    # a^m = sum over k of (m over k) a_0^(m - k) (a - a_0)^k
    coefficients = np.array(binomials) * centre ** (exponent - np.arange(n + 1)[:, None])
    # The least size of a value, NaN where the power may be singular or not real there
    nearest = np.where(low > 0, low, -high if either_sign else np.nan)
    farthest = np.maximum(np.abs(low), np.abs(high))
    # |(m over n + 1) x^(m - n - 1)| is monotone in |x|: largest at the end nearest to 0 or farthest from it
    largest = np.maximum(nearest ** (exponent - n - 1), farthest ** (exponent - n - 1))
    last = np.where(nearest > 0, np.abs(next_) * largest, np.inf)
    # a fractional exponent is rounded, which counts log a times
    logs = 1 + np.abs(np.log(np.abs(centre)))
    error = (FUNCTION_COEFFICIENT_ERROR + 4 * EPS * (n + abs(exponent)) * logs) * np.abs(coefficients)
    return compose_model(a, coefficients, (1 + POWER_ERROR) * last, values, error)


def power_model(a: TaylorModel, n: int) -> TaylorModel:
    """a^n for a whole number n that is not 0, by squaring for n > 0."""
    values = interval.integer_power(a.range, n)
    if n < 0:
        return _power_series(a, float(n), values)
    product = a
    for bit in bin(n)[3:]:
        product = product * product * a if bit == "1" else product * product
    return tighten_model(product.basis, product.c, product.rad, values)


def root_model(a: TaylorModel, k: float) -> TaylorModel:
    """a^k for a k that is no whole number, where a > 0. Nothing is known where a may be 0 or negative."""
    positive = a.range[0] > 0
    lower, upper = interval.positive_part_power(a.range, k)
    return _power_series(a, k, (np.where(positive, lower, -np.inf), np.where(positive, upper, np.inf)))


def positive_power_model(a: TaylorModel, k: float) -> TaylorModel:
    """a_+^k for k != 0. Where a has both signs and a >= -d, it is a^k up to d^k for a whole k > 0.

    For any other k only its range is known there.
    """
    lower, upper = a.range
    is_integer = k > 0 and k == int(k)

    def enclose_positive(a: TaylorModel) -> TaylorModel:
        """a_+^k where a > 0, or k is whole: |a^k - a_+^k| <= (-a)_+^k."""
        values = interval.positive_part_power(a.range, k)
        if not is_integer:
            return _power_series(a, k, values)
        whole_power = power_model(a, int(k))
        beyond = interval.positive_part_power((-a.range[1], -a.range[0]), k)[1]
        return tighten_model(a.basis, whole_power.c, whole_power.rad + beyond, values)

    def enclose_mixed(a: TaylorModel) -> TaylorModel:
        """The range of a_+^k, of which no polynomial is known where a has both signs."""
        return range_model(a.basis, interval.positive_part_power(a.range, k))

    # Where a <= 0 on the whole box it is 0, which apply_on_subsets has on all other boxes
    has_series = (lower > 0) | (is_integer & (upper > 0))
    return apply_on_subsets([(enclose_positive, has_series), (enclose_mixed, (upper > 0) & ~has_series)], a)


@QUIET
def polar_power_model(x: TaylorModel, y: TaylorModel, beta: float, phase: float, omega: float) -> TaylorModel:
    """r^beta cos(beta (theta - phase)) with x + i y = r exp(i theta), theta in [0, omega] and beta > 0.

    By the series of z^beta, z = x + i y, about the box's centre, which converges where |z| at the centre is
    larger than the box. From its term n + 1 on, each next term is at most `ratio` times as large.
    """
    n = x.basis.order
    # Turned by -omega / 2, angles are at most omega / 2 in size, and the cut of numpy's power is outside
    turn = np.exp(-0.5j * omega)
    z = (x.c + 1j * y.c) * turn
    sizes = np.abs(x.c) + np.abs(y.c)
    rad = x.rad + y.rad + 4 * EPS * sizes.sum(axis=0)
    # z = z_0 + w with |w| <= reach: z^beta = sum over k of (beta over k) z_0^(beta - k) w^k
    modulus = np.abs(z[0])
    reach = np.abs(z[1:]).sum(axis=0) + rad
    binomials = _binomial_coefficients(beta, n)
    exponents = beta - np.arange(n + 1)[:, None]
    coefficients = binomials[:-1] * z[0] ** exponents * np.exp(1j * beta * (0.5 * omega - phase))
    # The rounding of an exponent e counts log z_0 times in z_0^e, and |log z_0| <= |log |z_0|| + pi
    error = 8 * EPS * np.abs(coefficients) * (1 + np.abs(exponents) * (4 + np.abs(np.log(modulus))))
    # The terms from n + 1 on: |(beta over n + 1)| |z_0|^(beta - n - 1) reach^(n + 1) / (1 - ratio) at most
    ratio = (1 + POWER_ERROR) * max(1.0, (beta - n - 1) / (n + 2)) * reach / modulus
    last = np.where(ratio < 1, np.abs(binomials[-1]) * modulus ** (beta - n - 1) / (1 - ratio), np.inf)
    c, rad = compose_coefficients(x.basis, (z, rad), coefficients, (1 + POWER_ERROR) * last, error)
    # |z^beta cos(..)| <= |z|^beta, the range where the series does not converge
    reach = add_rounding(x.basis, modulus + reach)
    largest = interval.positive_part_power((reach, reach), beta)[1]
    return tighten_model(x.basis, c.real.copy(), rad, (-largest, largest))


MODEL_FUNCTIONS: dict[str, ModelFunction] = {
    "exp": _make_entire_function(lambda a: [np.exp(a)], interval.exp, interval.exp),
    "sin": _make_entire_function(
        lambda a: [np.sin(a), np.cos(a), -np.sin(a), -np.cos(a)], None, interval.sin
    ),
    "cos": _make_entire_function(
        lambda a: [np.cos(a), -np.sin(a), -np.cos(a), np.sin(a)], None, interval.cos
    ),
    "sinh": _make_entire_function(lambda a: [np.sinh(a), np.cosh(a)], interval.cosh, interval.sinh),
    "cosh": _make_entire_function(lambda a: [np.cosh(a), np.sinh(a)], interval.cosh, interval.cosh),
    "tanh": tanh_model,
}


def enclose_formula(
    formula: Expression, variables: Mapping[str, TaylorModel], step_values: StepValues | None = None
) -> TaylorModel:
    """A formula of the grammar, without logarithms, on the boxes of its variables' models.

    `step_values` gives the value (k,) that a jump pos(a, 0) has on each box, NaN where it has both.
    """
    like = next(iter(variables.values()))
    values = {Primitive(name): model for name, model in variables.items()}
    for step, value in (step_values or {}).items():
        undecided = np.isnan(value)
        values[step] = range_model(
            like.basis, (np.where(undecided, 0.0, value), np.where(undecided, 1.0, value))
        )
    return _ModelEvaluation((formula,), values).evaluate(formula)


class _ModelEvaluation(Evaluation[TaylorModel]):
    def number(self, value: Fraction) -> TaylorModel:
        """The model of a rational number."""
        return number_model(next(iter(self.values.values())), float(value))

    def constant(self, e: Expression) -> TaylorModel:
        """The model of an expression without variables."""
        return number_model(next(iter(self.values.values())), as_float_or_inf(e))

    def times(self, value: TaylorModel, e: Expression) -> TaylorModel:
        """A model times an expression without variables."""
        return value.scale(as_float_or_inf(e))

    def power(self, base: TaylorModel, k: Fraction) -> TaylorModel:
        """The model of a power."""
        return power_model(base, int(k)) if k.denominator == 1 else root_model(base, float(k))

    def function(self, primitive: Primitive) -> TaylorModel:
        """The model of a function of the grammar."""
        a = self.evaluate(primitive.args[0])
        if primitive.name != "pos":
            return MODEL_FUNCTIONS[primitive.name](a)
        k = as_float_or_inf(primitive.args[1])
        return positive_power_model(a, k) if k else _step_model(a)


def _step_model(a: TaylorModel) -> TaylorModel:
    """pos(a, 0), which is 1 where a > 0 and 0 elsewhere, as a model."""
    low, high = a.range
    return range_model(a.basis, (np.where(low > 0, 1.0, 0.0), np.where(high > 0, 1.0, 0.0)))
