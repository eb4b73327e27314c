"""Interval arithmetic on arrays: every result contains all values, for the rounding goes outward.

An interval is a pair (lower, upper) of arrays (k,), which are infinite where a bound is not known, and never
NaN. NumPy's sums and products are correctly rounded and its functions are off by at most four units in the
last place, also where these are subnormal; every result is widened by ROUNDING_ULPS of them.
"""

from __future__ import annotations

from functools import reduce

import numpy as np

from unilateral.arrays import Array, Mask

IntervalArrays = tuple[Array, Array]
ROUNDING_ULPS = 8
MIN_OVERFLOW = 1e308
"""A number that overflows is at least as large as this."""
POWER_ERROR_PER_FACTOR = 2.0**-50
"""Each factor of a power adds this to the relative rounding error of the power."""
EXPONENT_ERROR = 2.0**-51
"""The relative rounding error of a fractional exponent, and of the logarithm."""
EXTREMUM_TOLERANCE = 1e-12
"""An extremum of sin or cos counts as inside an interval if it is at most this far outside. The unit is 1
plus the absolute values of the interval's ends."""
QUIET = np.errstate(all="ignore")
"""NumPy's warnings are not needed: what overflows, or is NaN then, becomes an infinite bound."""


@QUIET
def round_outward(lower: Array, upper: Array) -> IntervalArrays:
    """The interval widened by the rounding; what overflows is at least MIN_OVERFLOW in size."""
    lower = np.minimum(lower, MIN_OVERFLOW)
    upper = np.maximum(upper, -MIN_OVERFLOW)
    lower = lower - ROUNDING_ULPS * np.spacing(np.abs(lower))
    upper = upper + ROUNDING_ULPS * np.spacing(np.abs(upper))
    return np.fmax(lower, -np.inf), np.fmin(upper, np.inf)  # NaN, which is inf - inf, becomes infinite


@QUIET
def add_intervals(a: IntervalArrays, b: IntervalArrays) -> IntervalArrays:
    """The interval of all sums of a number of a and one of b."""
    return round_outward(a[0] + b[0], a[1] + b[1])


@QUIET
def multiply_intervals(a: IntervalArrays, b: IntervalArrays) -> IntervalArrays:
    """The interval of all products of a number of a and one of b."""
    products = [x * y for x in a for y in b]
    return round_outward(reduce(np.minimum, products), reduce(np.maximum, products))


@QUIET
def integer_power(base: IntervalArrays, n: int) -> IntervalArrays:
    """base^n for a whole number n, infinite where n < 0 and the base may be 0."""
    lower, upper = base
    # x^|n| is monotone for odd n, and even powers have their minimum 0 at 0
    inside = (lower <= 0) & (upper >= 0)
    at_lower = lower ** abs(n)
    at_upper = upper ** abs(n)
    low = np.minimum(at_lower, at_upper)
    high = np.maximum(at_lower, at_upper)
    if n % 2 == 0:
        low = np.where(inside, 0.0, low)
    low, high = round_outward(low, high)
    if n > 0:
        return low, high
    positive = (lower > 0) | (n % 2 == 0)  # powers that underflow keep their sign
    low = np.where(positive, np.maximum(low, 0.0), low)
    high = np.where(positive, high, np.minimum(high, -0.0))
    # 1/x falls where x keeps its sign; nothing is known where the power may be 0
    low, high = round_outward(1 / high, 1 / low)
    return np.where(inside, -np.inf, low), np.where(inside, np.inf, high)


@QUIET
def positive_part_power(base: IntervalArrays, k: float) -> IntervalArrays:
    """base_+^k; 0 where the base is 0, whatever the sign of k."""
    # base_+^k grows for k > 0, so that the ends are those of the base; for k < 0 it is the inverse, or 0
    if k < 0:
        low, high = integer_power(positive_part_power(base, -k), -1)
        return np.where(base[0] > 0, np.maximum(low, 0.0), 0.0), np.where(base[1] > 0, high, 0.0)
    low, high = round_outward(*(positive_power(end, k) for end in base))
    errors = [np.full_like(end, POWER_ERROR_PER_FACTOR * k) for end in base]
    if k != int(k):  # its rounding counts log of the base times
        logs = [np.abs(np.log(np.where(end > 0, end, 1.0))) for end in base]
        errors = [error + EXPONENT_ERROR * k * log for error, log in zip(errors, logs, strict=True)]
    low = low * (1 - errors[0])
    high = high * (1 + errors[1])
    return np.maximum(low, 0.0), np.where(base[1] > 0, high, 0.0)


def positive_power(a: Array, k: float) -> Array:
    """a_+^k elementwise: 0 where a <= 0, whatever the sign of k."""
    a = np.asarray(a, dtype=float)
    positive = a > 0
    safe = np.where(positive, a, 1.0)
    if k == int(k) and 0 <= k <= 8:
        # several times as fast as NumPy's power
        power = np.ones_like(safe)
        for _ in range(int(k)):
            power *= safe
    else:
        power = np.sqrt(safe) ** round(2 * k) if 2 * k == round(2 * k) else safe**k
    return np.where(positive, power, 0.0)


def sin(a: IntervalArrays) -> IntervalArrays:
    """The interval of sin."""
    return _enclose_wave(np.sin, a, 0.5 * np.pi)


def cos(a: IntervalArrays) -> IntervalArrays:
    """The interval of cos."""
    return _enclose_wave(np.cos, a, 0.0)


@QUIET
def _enclose_wave(function: np.ufunc, a: IntervalArrays, crest: float) -> IntervalArrays:
    """sin or cos, whose maxima are at `crest` + 2 pi times whole numbers."""
    # Between extrema the function is monotone: its range is that of the ends, unless an extremum lies inside
    lower, upper = a
    at_lower = function(lower)
    at_upper = function(upper)
    low, high = round_outward(np.minimum(at_lower, at_upper), np.maximum(at_lower, at_upper))
    near = EXTREMUM_TOLERANCE * (1 + np.abs(lower) + np.abs(upper))

    def contains(phase: float) -> Mask:
        """Whether the interval has a point phase + 2 pi m; true where its ends are not numbers."""
        first = np.ceil((lower - near - phase) / (2 * np.pi))
        return ~(first * 2 * np.pi + phase > upper + near)

    low = np.maximum(low, -1.0)
    high = np.minimum(high, 1.0)
    return np.where(contains(crest + np.pi), -1.0, low), np.where(contains(crest), 1.0, high)


@QUIET
def cosh(a: IntervalArrays) -> IntervalArrays:
    """The interval of cosh."""
    inside = (a[0] <= 0) & (a[1] >= 0)
    at_lower, at_upper = np.cosh(a)
    low = np.minimum(at_lower, at_upper)
    high = np.maximum(at_lower, at_upper)
    return round_outward(np.where(inside, 1.0, low), high)


@QUIET
def exp(a: IntervalArrays) -> IntervalArrays:
    """The interval of exp."""
    low, high = round_outward(np.exp(a[0]), np.exp(a[1]))
    return np.maximum(low, 0.0), high


@QUIET
def sinh(a: IntervalArrays) -> IntervalArrays:
    """The interval of sinh."""
    return round_outward(np.sinh(a[0]), np.sinh(a[1]))


@QUIET
def tanh(a: IntervalArrays) -> IntervalArrays:
    """The interval of tanh."""
    low, high = round_outward(np.tanh(a[0]), np.tanh(a[1]))
    return np.maximum(low, -1.0), np.minimum(high, 1.0)
