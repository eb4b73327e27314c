"""The positive part: as a function of sympy, and of arrays."""

from __future__ import annotations

import numpy as np
import sympy
from sympy.core.evalf import PrecisionExhausted
from sympy.core.function import ArgumentIndexError

from unilateral.arrays import Array

DIGITS = 2000


class pos(sympy.Function):
    """max(a, 0)**k; for k = 0 the indicator of a > 0."""

    nargs = 2

    @classmethod
    def eval(cls, a: sympy.Expr, k: sympy.Expr) -> sympy.Expr | None:
        if a.is_number:
            return a**k if _is_positive(a) else sympy.Integer(0)
        return None

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        a, k = self.args
        if argindex != 1 or k == 0:
            raise ArgumentIndexError(self, argindex)
        return k * pos(a, k - 1)


def rounded(number: sympy.Expr) -> sympy.Number:
    """A number as it is if it is rational, else to 17 digits, whatever cancels in it.

    Raises ValueError where it cannot be told from 0 by DIGITS digits.
    """
    if number.is_Rational:
        return number
    try:
        return number.evalf(17, maxn=DIGITS, strict=True)
    except PrecisionExhausted:
        raise ValueError(f"'{number}' cannot be told from 0; write it as a single number") from None


def _is_positive(number: sympy.Expr) -> bool:
    """Its value's sign; sympy's own test computes minimal polynomials, which may take for ever."""
    return bool(rounded(number) > 0)


def positive_power(a: Array, k: float) -> Array:
    """a_+^k elementwise: 0 where a <= 0, whatever the sign of k."""
    a = np.asarray(a, dtype=float)
    positive = a > 0
    safe = np.where(positive, a, 1.0)
    if k == int(k) and 0 <= k <= 8:
        power = np.ones_like(safe)
        for _ in range(int(k)):
            power *= safe
    else:
        power = np.sqrt(safe) ** round(2 * k) if 2 * k == round(2 * k) else safe**k
    return np.where(positive, power, 0.0)
