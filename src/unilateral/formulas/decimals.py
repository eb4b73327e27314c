"""Numbers as text, rounded in one direction, so that a printed bound is still a bound.

>>> format_up(4 / 3, ".4e"), format_down(4 / 3, ".4e"), f"{4 / 3:.4e}"
('1.3334e+00', '1.3333e+00', '1.3333e+00')
"""

from __future__ import annotations

import math
import re
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal, localcontext

EXACT_SUM_DIGITS = 1100
"""With this many digits sums of two floating-point numbers are exact."""
MAX_PLAIN_DIGITS = 6
"""Numbers of up to this many digits before the point are written without a power of ten."""
FORMAT_SPEC = re.compile(r"\.(\d+)([efg])")
"""The format specifications of Python that are allowed here."""


def format_up(x: float | Decimal, spec: str) -> str:
    """The least number of the format that is not below x, as Python would write it.

    Exact for every x; one that is not finite is written as it is. Raises ValueError for a `spec` other than
    those such as ".4e", ".2f" and ".3g".
    """
    return _format_rounding(x, spec, ROUND_CEILING)


def format_down(x: float | Decimal, spec: str) -> str:
    """The largest number of the format that is not above x, written as by `format_up`."""
    return _format_rounding(x, spec, ROUND_FLOOR)


def format_percent(share: float) -> str:
    """A part of a whole in percent, rounded up.

    >>> format_percent(0.0451)
    '4.6 %'
    """
    with localcontext(prec=EXACT_SUM_DIGITS):
        return f"{format_up(Decimal(share).scaleb(2), '.2g')} %"


def format_interval(lower: float, upper: float, value: float = math.nan, spec: str = "") -> str:
    """An approximate value and the ends of an interval that contains the number, rounded outwards, as text.

    An end that is infinite or NaN is not known, and a value that is not finite is left out. Without a `spec`
    both ends are written as the least distance of two digits from the value. A lower end of 0 alone is not
    printed: every norm, constant and contact force has it.

    >>> format_interval(6.0135, 6.2266, 6.1144), format_interval(6.0135, 6.2266, 6.1144, ".2f")
    ('6.11 ± 0.12', '6.11, between 6.01 and 6.23')
    >>> inf = math.inf
    >>> format_interval(-inf, 2 / 3), format_interval(1, inf, 1.5), format_interval(-inf, 2.0, 1.5)
    ('at most 0.6667', '1.5, at least 1', '1.5, at most 2')
    >>> format_interval(0, inf, 1.5), format_interval(-inf, inf, 1.5), format_interval(math.nan, math.nan)
    ('1.5, no upper bound', '1.5, no bound', 'unknown')
    """
    has_lower = math.isfinite(lower)
    has_upper = math.isfinite(upper)
    has_value = math.isfinite(value)
    if has_lower and has_upper and has_value and not spec:
        return _format_plus_minus(value, lower, upper)
    spec = spec or ".4g"
    if has_lower and has_upper:
        ends = f"between {format_down(lower, spec)} and {format_up(upper, spec)}"
    elif has_upper:
        ends = f"at most {format_up(upper, spec)}"
    elif has_lower and lower != 0:
        ends = f"at least {format_down(lower, spec)}"
    elif has_value:
        ends = "no upper bound" if has_lower else "no bound"
    else:
        ends = "unknown"
    return f"{value:{spec}}, {ends}" if has_value else ends


def has_bound(lower: float, upper: float) -> bool:
    """Whether more is known of a number than, at most, that it is not negative; see `format_interval`."""
    return math.isfinite(upper) or (math.isfinite(lower) and lower != 0)


def add_guarantee(text: str, lower: float, upper: float) -> str:
    """The text of an interval, with the word "guaranteed" after it if at least one end is known."""
    return f"{text}, guaranteed" if has_bound(lower, upper) else text


def interval_record(value: float, lower: float, upper: float) -> dict[str, float | str | None]:
    """An interval about a value for programs: `known` says which of its ends are: both, lower, upper or None.

    Numbers that are not finite become null in JSON.
    """
    ends = {"lower": lower, "upper": upper}
    finite = [name for name, end in ends.items() if math.isfinite(end)]
    return {"value": value, **ends, "known": "both" if len(finite) == 2 else "".join(finite) or None}


def _format_plus_minus(value: float, lower: float, upper: float) -> str:
    """A number and the least distance, of two digits, that leaves both bounds between them.

    >>> _format_plus_minus(6e9, 6e9, 6.1e9)
    '(6.00 ± 0.10)e+09'
    """
    with localcontext(prec=EXACT_SUM_DIGITS):
        exact = Decimal(value)
        low = Decimal(lower)
        high = Decimal(upper)
        apart = max(high - exact, exact - low)
        if not (exact or apart):
            return "0 ± 0"
        # Beyond these sizes both are written with the same power of ten
        largest = max(abs(exact), apart)
        power = largest.adjusted() if largest and not -4 <= largest.adjusted() < MAX_PLAIN_DIGITS else 0
        # Both end with the second digit of the distance, or with the number's eighth if there is none
        digit = Decimal(1).scaleb((apart.adjusted() if apart else exact.adjusted() - MAX_PLAIN_DIGITS) - 1)
        # The distance is taken from the rounded value, so that the rounding of both is in it
        rounded = exact.quantize(digit)
        wide = max(high - rounded, rounded - low).quantize(digit, ROUND_CEILING)
        text = " ± ".join(format(number.scaleb(-power), "f") for number in (rounded, wide))
    return f"({text})e{power:+03d}" if power else text


def _format_rounding(x: float | Decimal, spec: str, rounding: str) -> str:
    """x in the format, rounded by the mode of `decimal`; Python's own format would round to nearest."""
    match = FORMAT_SPEC.fullmatch(spec)
    if match is None:
        raise ValueError(f"'{spec}' is not a format such as .4e, .2f or .3g")
    if x == 0 or not math.isfinite(x):
        return format(x, spec)
    with localcontext(rounding=rounding):
        if match[2] == "f":
            return format(Decimal(x), spec)
        # Python writes decimals with other zeros and exponents than floats: "e" and "g" are put together here
        general = match[2] == "g"
        digits = max(int(match[1]), 1) if general else int(match[1]) + 1
        mantissa, _, power = format(Decimal(x), f".{digits - 1}e").partition("e")
    exponent = int(power)
    if general and -4 <= exponent < digits:
        return _strip_zeros(format(Decimal(f"{mantissa}e{exponent}"), "f"))
    return f"{_strip_zeros(mantissa) if general else mantissa}e{exponent:+03d}"


def _strip_zeros(number: str) -> str:
    """The number without zeros at the end of its decimals."""
    return number.rstrip("0").rstrip(".") if "." in number else number
