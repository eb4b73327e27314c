"""Numbers as readers see them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence


def span(values: Sequence[float], text: Callable[[float], str]) -> str:
    """The least and the largest as text, or the one text of both."""
    ends = dict.fromkeys(text(each) for each in (min(values), max(values)))
    return " to ".join(ends)


def level(stop: float) -> str:
    return f"10^(−{-math.log10(stop):.0f})" if stop < 1 else "1"


def size(h: float) -> str:
    return f"1/{1 / h:.0f}"


def times(factor: float) -> str:
    return f"× {factor:.0f}"


def percent(value: float) -> str:
    return f"{100 * value:.2g} %"


def power(value: float) -> str:
    digits, exponent = f"{value:.1e}".split("e")
    return f"{digits}·10^{int(exponent)}"
