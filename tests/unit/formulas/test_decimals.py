"""What is printed of a bound is a bound: by the exact values of both, as decimal numbers."""

import math
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from unilateral.formulas.decimals import format_down, format_interval, format_percent, format_up

SPECS = (".4e", ".0e", ".1e", ".2f", ".0f", ".6g", ".3g", ".1g")
FINITE = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=500, derandomize=True, deadline=None)
@given(
    st.one_of(FINITE, st.floats(1e-4, 10), st.decimals(-9, 9, places=2).map(float)), st.sampled_from(SPECS)
)
@example(4 / 3, ".4e")
@example(1.12763112e-03, ".4e")
@example(0.1 + 0.2, ".1e")
@example(9.99999, ".3g")
@example(5e-324, ".2f")
@example(-5e-324, ".4e")
@example(1.7976931348623157e308, ".1e")
def test_a_number_lies_between_what_is_printed_below_and_above_it(x, spec):
    """And nothing nearer could have been printed: what Python rounds to nearest is one of both."""
    lower = format_down(x, spec)
    upper = format_up(x, spec)
    assert Decimal(lower) <= Decimal(x) <= Decimal(upper)
    assert format(x, spec) in (lower, upper)
    assert (lower == upper) == (Decimal(lower) == Decimal(x))


def test_plain_rounding_misses_both_ways():
    assert Decimal(f"{4 / 3:.4e}") < Decimal(4 / 3) < Decimal(format_up(4 / 3, ".4e"))
    assert Decimal(format_down(2 / 3, ".4e")) < Decimal(2 / 3) < Decimal(f"{2 / 3:.4e}")


@pytest.mark.parametrize("x", [0.0, -0.0, math.inf, -math.inf, math.nan])
@pytest.mark.parametrize("spec", SPECS)
def test_what_has_no_digits_is_written_as_it_is(x, spec):
    assert format_up(x, spec) == format_down(x, spec) == format(x, spec)


def test_an_interval_is_printed_between_its_rounded_bounds():
    assert format_interval(1 / 3, 2 / 3, spec=".2f") == "between 0.33 and 0.67"
    assert format_interval(4 / 3, 4 / 3, 4 / 3, ".4e") == "1.3333e+00, between 1.3333e+00 and 1.3334e+00"


@pytest.mark.parametrize("spec", ["", "4e", ".e", ".2%", "10.2f", ".2F"])
def test_other_formats_are_refused(spec):
    with pytest.raises(ValueError, match="is not a format such as"):
        format_up(1.0, spec)


def test_a_number_with_its_distance_has_both_bounds_between():
    """In fractions, at all scales; the distance is at most 1.2 times the larger one to the bounds."""
    rng = np.random.default_rng(5)
    for _ in range(2000):
        value = float(rng.normal() * 10.0 ** rng.uniform(-300, 300))
        below = float(10.0 ** rng.uniform(-12, 3) * abs(value))
        above = float(10.0 ** rng.uniform(-12, 3) * abs(value))
        lower = value - below
        upper = value + above
        text = format_interval(lower, upper, value)
        displayed, _, wide = text.partition(" ± ")
        power = Fraction(10) ** int(text.partition("e")[2] or 0)
        displayed = Fraction(displayed.strip("()").partition(")")[0]) * power
        wide = Fraction(wide.strip("()").partition(")")[0]) * power
        assert displayed - wide <= Fraction(lower) <= Fraction(upper) <= displayed + wide
        exact, low, high = map(Fraction, (value, lower, upper))
        assert wide <= Fraction(12, 10) * max(high - exact, exact - low)


def test_a_number_is_printed_with_the_only_bound_that_is_known():
    assert format_interval(0.0, 0.0, 0.0) == "0 ± 0"
    assert format_interval(1.23456, math.inf, 2.0) == "2, at least 1.234"
    assert format_interval(-math.inf, 0.55485, 0.4857) == "0.4857, at most 0.5549"


@given(st.floats(1e-300, 1e300))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_a_percentage_is_not_below_the_part(share):
    fraction = Fraction(format_percent(share).removesuffix(" %"))
    assert 100 * Fraction(share) <= fraction <= 111 * Fraction(share)
