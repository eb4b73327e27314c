"""The values and signs of numbers such as sqrt(2) or sin(1), whatever cancels; functions of formulas."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache, lru_cache
from typing import Any

from unilateral.formulas.expression import PI, ZERO, Atom, Expression, Number, expression, number
from unilateral.formulas.formula_walk import Evaluation

PRECISIONS = (160, 640, 2560, 6656)
"""The bits that intervals have, one after the other until a number is known; the last are 2000 digits."""
SHARP = 2.0**-62
"""The middle of an interval has 17 digits if the interval's relative width is at most this."""
AT_ZERO = {"sin": 0, "cos": 1, "exp": 1, "sinh": 0, "cosh": 1, "tanh": 0}
SQUARES = {Fraction(n): Fraction(square, 4) for n, square in ((0, 0), (2, 1), (3, 2), (4, 3), (6, 4))}
"""The squares of sin(n pi/12), by n."""


def rounded(e: Expression) -> float:
    """The value of an expression without variables to 17 digits.

    Raises OverflowError or is infinite where it is too large. Raises ArithmeticError where it is no real
    number, and ValueError where it cannot be distinguished from 0.
    """
    return float(e.rational if e.rational is not None else _value(e))


def nearest(e: Expression) -> float:
    """As `rounded`, but infinite if the value is too large."""
    try:
        return rounded(e)
    except OverflowError:
        return sign(e) * math.inf


def sign(e: Expression) -> int:
    """The sign of an expression without variables, -1, 0 or 1; raises as `rounded`."""
    value = e.rational if e.rational is not None else _value(e)
    return int(value > 0) - int(value < 0)


def magnitude(e: Expression) -> int:
    """log2 |e| as a whole number, up to an error of 1, for a number e that is not 0; raises as `rounded`."""
    if e.rational is not None:
        return e.rational.numerator.bit_length() - e.rational.denominator.bit_length()
    return int(math.log2(math.e) * float(_intervals(PRECISIONS[0]).log(abs(_value(e))).mid))


@lru_cache(maxsize=1024)
def _value(e: Expression) -> Any:
    """The value, of any size: the middle of an interval that contains it."""
    for bits in PRECISIONS:
        enclosure = _Intervals(e, _intervals(bits)).of(e)
        if abs(enclosure).a > 0 and enclosure.delta <= SHARP * abs(enclosure).a:
            return enclosure.mid
    raise ValueError(f"'{e}' cannot be distinguished from 0; write it as a single number")


@cache
def _intervals(bits: int) -> Any:
    from mpmath.ctx_iv import MPIntervalContext  # which most formulas can do without

    context = MPIntervalContext()
    context.prec = bits
    return context


class _Intervals(Evaluation[Any]):
    """The values of numbers as intervals, each of which contains its number."""

    def __init__(self, e: Expression, context: Any) -> None:
        super().__init__((e,), {})
        self.context = context

    def number(self, value: Fraction) -> Any:
        return self.context.mpf(value.numerator) / value.denominator

    def power(self, base: Any, k: Fraction) -> Any:
        return base ** int(k) if k.denominator == 1 else self.context.exp(self._log(base) * self.number(k))

    def function(self, of: Atom) -> Any:
        iv = self.context
        if of.name == "pi":
            return +iv.pi
        a = self.of(of.args[0])
        if of.name == "log":
            return self._log(a)
        if of.name in ("sin", "cos", "exp"):
            return getattr(iv, of.name)(a)
        up = iv.exp(a)
        down = iv.exp(-a)
        total = up + down
        return {"sinh": (up - down) / 2, "cosh": total / 2, "tanh": 1 - 2 * down / total}[of.name]

    def _log(self, a: Any) -> Any:
        if a.b <= 0:
            raise ArithmeticError("no real number")
        return self.context.log(a) if a.a > 0 else self.context.mpf(["-inf", "inf"])


def apply(name: str, *args: Expression) -> Expression:
    """A function of the grammar, or its value where that is known.

    Raises as `sign` where it needs the sign of a number.
    """
    a = args[0]
    if name == "pos" and not a.variables:
        k = args[1].rational
        return a**k if k is not None and sign(a) > 0 else ZERO
    if a.rational == 0 and name in AT_ZERO:
        return number(AT_ZERO[name])
    if a.rational == 1 and name == "log":
        return ZERO
    turns = (a / PI).rational
    if name in ("sin", "cos") and turns is not None:
        n = 12 * turns + (6 if name == "cos" else 0)
        if min(n % 12, -n % 12) in SQUARES:
            root = number(SQUARES[min(n % 12, -n % 12)]) ** Fraction(1, 2)
            return root.scaled(-1 if n % 24 > 12 else 1)
    return expression(Atom(name, args))


def pos(a: Expression, k: Number) -> Expression:
    """The power a_+^k of the positive part."""
    return apply("pos", a, number(k))
