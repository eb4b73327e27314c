"""The values and signs of numbers such as sqrt(2) or sin(1), whatever cancels; functions of formulas."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

from unilateral.formulas.expression import (
    PI,
    ZERO,
    Expression,
    Number,
    Primitive,
    primitive_expression,
    rational_expression,
)
from unilateral.formulas.formula_walk import Evaluation

INTERVAL_BITS = (160, 640, 2560, 6656)
"""The bits that intervals have, one after the other until a number is known; the last are 2000 digits."""
MAX_RELATIVE_WIDTH = 2.0**-62
"""The middle of an interval has 17 digits if the interval's relative width is at most this."""
VALUES_AT_ZERO = {"sin": 0, "cos": 1, "exp": 1, "sinh": 0, "cosh": 1, "tanh": 0}
SINE_SQUARES = {Fraction(n): Fraction(square, 4) for n, square in ((0, 0), (2, 1), (3, 2), (4, 3), (6, 4))}
"""The squares of sin(n pi/12), by n."""


def as_float(e: Expression) -> float:
    """The value of an expression without variables to 17 digits.

    Raises OverflowError or is infinite where it is too large. Raises ArithmeticError where it is no real
    number, and ValueError where it cannot be distinguished from 0.
    """
    return float(e.rational if e.rational is not None else _high_precision_value(e))


def as_float_or_inf(e: Expression) -> float:
    """The value of an expression without variables to 17 digits, infinite if it is too large."""
    try:
        return as_float(e)
    except OverflowError:
        return sign(e) * math.inf


def sign(e: Expression) -> int:
    """The sign of an expression without variables, -1, 0 or 1; raises as `as_float`."""
    value = e.rational if e.rational is not None else _high_precision_value(e)
    return int(value > 0) - int(value < 0)


def log2_magnitude(e: Expression) -> int:
    """log2 |e| as a whole number, up to an error of 1, for a number e that is not 0; raises as `as_float`."""
    if e.rational is not None:
        return e.rational.numerator.bit_length() - e.rational.denominator.bit_length()
    natural_log = _interval_context(INTERVAL_BITS[0]).log(abs(_high_precision_value(e)))
    return int(math.log2(math.e) * float(natural_log.mid))


@lru_cache(maxsize=1024)
def _high_precision_value(e: Expression) -> Any:
    """The value, of any size: the middle of an interval that contains it."""
    for bits in INTERVAL_BITS:
        enclosure = _IntervalEvaluation(e, _interval_context(bits)).evaluate(e)
        if abs(enclosure).a > 0 and enclosure.delta <= MAX_RELATIVE_WIDTH * abs(enclosure).a:
            return enclosure.mid
    raise ValueError(f"'{e}' cannot be distinguished from 0; write it as a single number")


@cache
def _interval_context(bits: int) -> Any:
    """mpmath's intervals whose ends have so many bits."""
    from mpmath.ctx_iv import MPIntervalContext  # which most formulas can do without

    context = MPIntervalContext()
    context.prec = bits
    return context


class _IntervalEvaluation(Evaluation[Any]):
    """The values of numbers as intervals, each of which contains its number."""

    def __init__(self, e: Expression, context: Any) -> None:
        super().__init__((e,), {})
        self.context = context

    def number(self, value: Fraction) -> Any:
        """An interval that contains the rational number."""
        return self.context.mpf(value.numerator) / value.denominator

    def power(self, base: Any, k: Fraction) -> Any:
        """An interval that contains all base^k."""
        return base ** int(k) if k.denominator == 1 else self.context.exp(self._log(base) * self.number(k))

    def function(self, primitive: Primitive) -> Any:
        """An interval that contains the value of pi or of a function."""
        iv = self.context
        if primitive.name == "pi":
            return +iv.pi
        a = self.evaluate(primitive.args[0])
        if primitive.name == "log":
            return self._log(a)
        if primitive.name in ("sin", "cos", "exp"):
            return getattr(iv, primitive.name)(a)
        # By e^a and e^-a; tanh as 1 - 2 e^-a / (e^a + e^-a), in which nothing cancels for large a
        up = iv.exp(a)
        down = iv.exp(-a)
        total = up + down
        return {"sinh": (up - down) / 2, "cosh": total / 2, "tanh": 1 - 2 * down / total}[primitive.name]

    def _log(self, a: Any) -> Any:
        """An interval that contains log of all positive numbers in a, everything if a reaches 0."""
        if a.b <= 0:
            raise ArithmeticError("no real number")
        return self.context.log(a) if a.a > 0 else self.context.mpf(["-inf", "inf"])


def apply_function(name: str, *args: Expression) -> Expression:
    """A function of the grammar, or its value where that is known.

    Raises as `sign` where it needs the sign of a number.
    """
    a = args[0]
    # pos(a, k) = a_+^k of a number; the grammar refuses a k that is not rational
    if name == "pos" and not a.variables:
        k = args[1].rational
        return a**k if k is not None and sign(a) > 0 else ZERO
    if a.rational == 0 and name in VALUES_AT_ZERO:
        return rational_expression(VALUES_AT_ZERO[name])
    if a.rational == 1 and name == "log":
        return ZERO
    turns = (a / PI).rational
    if name in ("sin", "cos") and turns is not None:
        # sin(n pi / 12), below 0 for n in (12, 24), and |sin| has the period 12; cos(a) = sin(a + pi / 2)
        n = 12 * turns + (6 if name == "cos" else 0)
        if min(n % 12, -n % 12) in SINE_SQUARES:
            root = rational_expression(SINE_SQUARES[min(n % 12, -n % 12)]) ** Fraction(1, 2)
            return root.scale(-1 if n % 24 > 12 else 1)
    return primitive_expression(Primitive(name, args))


def pos(a: Expression, k: Number) -> Expression:
    """The power a_+^k of the positive part."""
    return apply_function("pos", a, rational_expression(k))
