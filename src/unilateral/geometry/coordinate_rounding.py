"""To how many digits numbers were rounded, and how far coordinates may be from their true places for that."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array

UNROUNDED_DIGITS = 16
"""Double precision has at least 15 digits; numbers that need more were not rounded to fewer."""
MAX_TYPED_DIGITS = 3
"""Numbers of no more significant digits are exact: no program rounds so far, a person wrote them."""
DECIMAL_TOLERANCE = 0.01
"""Decimals that were moved, or scaled by a power of ten, miss decimals by less than this part of a unit."""
NODE_ERROR_PER_DIAMETER = 1e-12
"""Programs place the nodes of a side up to this part of the domain's diameter: gmsh's transfinite curves are
1e-13 of it off, its other ones an ulp of the largest coordinate."""
COORDINATE_ERROR_ULPS = 4
"""So many units in the last place of the largest coordinate are added, for sums of a few rounded terms."""


def significant_digits(values: ArrayLike) -> int:
    """The number of significant digits with which all `values` can be written exactly, 0 for zeros alone.

    It is at most 17. Of numbers that were rounded to d digits it is d, unless all of them end in zeros.

    >>> significant_digits([0.25, 1.125, 0, 300]), significant_digits(1 / 3)
    (4, 16)
    """
    distinct: list[float] = np.unique(np.asarray(values, dtype=float)).tolist()
    texts = (repr(abs(value)) for value in distinct)
    return max((len(text.split("e")[0].replace(".", "").strip("0")) for text in texts), default=0)


def rounding_units(values: ArrayLike) -> Array:
    """The unit of the last digit to which each number was rounded, 0 where they have all digits of a double.

    The numbers were written together, such as the coordinates of a mesh, and each differs from the one that
    was rounded by at most half its unit. They may have been rounded to a number of decimals, of significant
    digits, or to single precision. Where several of these explain the numbers, the largest unit counts. A
    difference or a multiple of rounded numbers is a decimal up to round-off, and counts as one.

    >>> rounding_units([0.1234, 0.5, 1.25]).tolist(), rounding_units([1 / 3, 0.5]).tolist()
    ([0.0001, 0.0001, 0.001], [0.0, 0.0])
    """
    # Decimals explain the numbers up to half a unit, and so may single precision
    numbers = np.abs(np.asarray(values, dtype=float))
    decimal = np.maximum(_significant_units(numbers), _decimal_unit(numbers))
    return np.maximum(decimal, _single_precision_units(numbers, 0.5 * decimal))


def has_typed_digits(values: ArrayLike) -> bool:
    """Whether numbers have so few digits, at most MAX_TYPED_DIGITS, that nobody rounded them."""
    numbers = np.abs(np.asarray(values, dtype=float))
    return bool(np.all((numbers == 0) | (numbers < 10**MAX_TYPED_DIGITS * rounding_units(numbers))))


def arithmetic_error(points: Array) -> float:
    """How far round-off in another program may have moved the places (n, 2) of a mesh."""
    diameter = float(np.hypot(*np.ptp(points, axis=0)))
    ulp = float(np.spacing(np.abs(points).max()))
    return COORDINATE_ERROR_ULPS * ulp + NODE_ERROR_PER_DIAMETER * diameter


def rounding_errors_of_points(points: Array) -> Array:
    """How far rounded points may be from the true ones: half a unit in either coordinate, (n,).

    Of places as a person typed them the unit is 0, or that of single precision if they are kept in it.
    """
    units = _single_precision_units(points, 0.0) if has_typed_digits(points) else rounding_units(points)
    return 0.5 * np.hypot(*units.T)


def max_point_error(points: Array) -> float:
    """How far places (n, 2) may be from the true ones at most, by their digits and by arithmetic."""
    return float(rounding_errors_of_points(points).max()) + arithmetic_error(points)


def _significant_units(numbers: Array) -> Array:
    """The units if all numbers have the same number of significant digits; 0 where they are not short."""
    digits = significant_digits(numbers)
    if not 0 < digits < UNROUNDED_DIGITS:
        return np.zeros(numbers.shape)
    # x = a.bc.. 10^p with d significant digits: its last digit counts 10^(p - d + 1)
    with np.errstate(divide="ignore"):
        leading = np.where(numbers > 0, np.floor(np.log10(numbers)), -np.inf)
    return 10.0 ** (leading - digits + 1)


def _single_precision_units(numbers: Array, tolerance: Array | float) -> Array:
    """The units of single precision, if all numbers differ by at most `tolerance` from ones in it; else 0."""
    with np.errstate(over="ignore", under="ignore"):
        single = numbers.astype(np.float32)
    if np.all(np.abs(numbers - single) <= tolerance):
        return np.spacing(np.abs(single)).astype(float)
    return np.zeros(numbers.shape)


def _decimal_unit(numbers: Array) -> float:
    """The unit if all numbers have the same number of decimals, up to round-off; 0 if they have not."""
    largest = float(numbers.max(initial=0.0))
    if largest == 0:
        return 0.0
    # The first number of decimals with which the largest value has MAX_TYPED_DIGITS digits
    decimals = MAX_TYPED_DIGITS - 1 - int(np.floor(np.log10(largest)))
    # As long as a double tells a decimal from its neighbours clearly.
    while float(np.spacing(largest)) * 10.0**decimals < 0.1 * DECIMAL_TOLERANCE:
        scaled = numbers * 10.0**decimals
        if np.all(np.abs(scaled - np.round(scaled)) <= DECIMAL_TOLERANCE):
            return float(10.0**-decimals)
        decimals += 1
    return 0.0
