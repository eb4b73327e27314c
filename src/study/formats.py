"""Numbers as readers see them: Python's format specifications, and a few of our own.

| format | of | shown |
|---|---|---|
| `1/n` | 0.0625 | 1/16 |
| `10^` | 1e-6 | 10^(−6) |
| `x10^` | 1.94e9 | 1.9·10^9 |
| `down.2f`, `up.2f` | 0.719, 0.711 | 0.71, 0.72 |
| `up.1g%`, `up.short` | 0.0046, 6.811e-06 | 0.5 %, 6.82·10^(−6) |
| `space` | 20000 | 20 000 |
| `times` | 8.1 | × 8 |
| `short` | 6.81e-06 | 6.81·10^(−6) |
| `.2g%` | 0.0046 | 0.46 % |
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping

from unilateral.formulas.decimals import format_down, format_up

Value = float | int | str
DASH = "–"
"""What readers see where there is no number."""
SPACES = {"h1": "$H^1$", "hm12": "$H^{-1/2}$", "l2": "$L^2$"}
ERROR_TITLES = {
    norm: ("$u$" if norm == "h1" else r"$\lambda$") + f" in {space}" for norm, space in SPACES.items()
}
"""The titles of errors, by the norm in which they are measured."""
DIRECTED_FORMAT = re.compile(r"(down|up)(\.\d[efg])(%?)")
"""Formats that round a bound down or up, towards the side on which it stays a bound."""


def format_value(value: Value, spec: str = "") -> str:
    """The value in that format. Raises ValueError for an unknown format, or one that does not fit."""
    if isinstance(value, str):
        return format(value, spec)
    if not math.isfinite(value):
        raise ValueError("it is not finite")
    if spec in OWN_FORMATS:
        return OWN_FORMATS[spec](value)
    if directed := DIRECTED_FORMAT.fullmatch(spec):
        towards, away = (format_down, -math.inf) if directed[1] == "down" else (format_up, math.inf)
        percent = math.nextafter(100 * value, away)
        return f"{towards(percent, directed[2])} %" if directed[3] else towards(value, directed[2])
    return f"{100 * value:{spec[:-1]}} %" if spec.endswith("%") else format(value, spec)


def format_span(values: Iterable[float], spec: str) -> str:
    """The least and the largest value in that format; one text if both look the same."""
    numbers = list(values)
    return " to ".join(dict.fromkeys(format_value(end, spec) for end in (min(numbers), max(numbers))))


def format_row(values: Mapping[str, Value], columns: Mapping[str, tuple[str, str]]) -> dict[str, str]:
    """A row of a table; `columns` has the name of a value and its format, by the column's title."""
    return {title: format_value(values[name], spec) for title, (name, spec) in columns.items()}


def _format_power(stop: float) -> str:
    if stop <= 0:
        raise ValueError("it is no power of ten")
    return f"10^({round(math.log10(stop))})".replace("-", "−") if stop != 1 else "1"


def _format_unit_fraction(h: float) -> str:
    if not 0 < h <= 1:
        raise ValueError("it is no size from 0 to 1")
    return f"1/{1 / h:.0f}"


def _format_scientific(value: float) -> str:
    digits, exponent = f"{value:.1e}".split("e")
    return f"{digits}·10^{int(exponent)}"


def _replace_exponent(text: str) -> str:
    """The text of a number, with a power of ten in the place of an exponent."""
    mantissa, _, exponent = text.partition("e")
    if not exponent:
        return text
    power = f"10^{int(exponent)}" if int(exponent) > 0 else f"10^(−{-int(exponent)})"
    return power if mantissa == "1" else f"{mantissa}·{power}"


OWN_FORMATS: dict[str, Callable[[float], str]] = {
    "1/n": _format_unit_fraction,
    "10^": _format_power,
    "x10^": _format_scientific,
    "times": lambda x: f"× {x:.0f}",
    "space": lambda x: f"{x:,.0f}".replace(",", " "),
    "short": lambda x: _replace_exponent(f"{x:.3g}"),
    "up.short": lambda x: _replace_exponent(format_up(x, ".3g")),
}
