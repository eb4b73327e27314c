"""Numbers as text, rounded in one direction, so that a printed bound is still a bound.

>>> up(4 / 3, ".4e"), down(4 / 3, ".4e"), f"{4 / 3:.4e}"
('1.3334e+00', '1.3333e+00', '1.3333e+00')
"""

from __future__ import annotations

import math
import re
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext

SPEC = re.compile(r"\.(\d+)([efg])")
"""The format specifications of Python that are allowed here."""


def up(x: float, spec: str) -> str:
    """The least number of the format that is not below x, as Python would write it.

    Exact for every x; one that is not finite is written as it is. Raises ValueError for a `spec` other than
    those such as ".4e", ".2f" and ".3g".
    """
    return _rounded(x, spec, ROUND_CEILING)


def down(x: float, spec: str) -> str:
    """The largest number of the format that is not above x, written as by `up`."""
    return _rounded(x, spec, ROUND_FLOOR)


def between(lower: float, upper: float, spec: str, word: str = "to") -> str:
    """Two bounds with a word between them."""
    return f"{down(lower, spec)} {word} {up(upper, spec)}"


def _rounded(x: float, spec: str, rounding: str) -> str:
    parts = SPEC.fullmatch(spec)
    if parts is None:
        raise ValueError(f"'{spec}' is not a format such as .4e, .2f or .3g")
    if x == 0 or not math.isfinite(x):
        return format(x, spec)
    with localcontext(rounding=rounding):
        if parts[2] == "f":
            return format(Decimal(x), spec)
        general = parts[2] == "g"
        digits = max(int(parts[1]), 1) if general else int(parts[1]) + 1
        mantissa, _, power = format(Decimal(x), f".{digits - 1}e").partition("e")
    exponent = int(power)
    if general and -4 <= exponent < digits:
        return _short(format(Decimal(f"{mantissa}e{exponent}"), "f"))
    return f"{_short(mantissa) if general else mantissa}e{exponent:+03d}"


def _short(number: str) -> str:
    """The number without zeros at the end of its decimals."""
    return number.rstrip("0").rstrip(".") if "." in number else number
