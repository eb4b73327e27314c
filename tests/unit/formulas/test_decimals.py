"""What is printed of a bound is a bound: by the exact values of both, as decimal numbers."""

import math
from decimal import Decimal

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from unilateral.formulas.decimals import between, down, up

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
    lower, upper = down(x, spec), up(x, spec)
    assert Decimal(lower) <= Decimal(x) <= Decimal(upper)
    assert format(x, spec) in (lower, upper)
    assert (lower == upper) == (Decimal(lower) == Decimal(x))


def test_plain_rounding_misses_both_ways():
    assert Decimal(f"{4 / 3:.4e}") < Decimal(4 / 3) < Decimal(up(4 / 3, ".4e"))
    assert Decimal(down(2 / 3, ".4e")) < Decimal(2 / 3) < Decimal(f"{2 / 3:.4e}")


@pytest.mark.parametrize("x", [0.0, -0.0, math.inf, -math.inf, math.nan])
@pytest.mark.parametrize("spec", SPECS)
def test_what_has_no_digits_is_written_as_it_is(x, spec):
    assert up(x, spec) == down(x, spec) == format(x, spec)


def test_two_bounds():
    assert between(1 / 3, 2 / 3, ".2f") == "0.33 to 0.67"
    assert between(4 / 3, 4 / 3, ".4e", "and") == "1.3333e+00 and 1.3334e+00"


@pytest.mark.parametrize("spec", ["", "4e", ".e", ".2%", "10.2f", ".2F"])
def test_other_formats_are_refused(spec):
    with pytest.raises(ValueError, match="is not a format such as"):
        up(1.0, spec)
