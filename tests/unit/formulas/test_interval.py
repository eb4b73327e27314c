"""Interval arithmetic: known ranges, and nothing wider than rounding; enclosure is in test_against_arb.py."""

import numpy as np
import pytest

from unilateral.formulas import interval


@pytest.mark.parametrize("name", ["sin", "cos", "exp", "sinh", "cosh", "tanh"])
def test_at_points_nothing_is_wider_than_rounding(name):
    x = np.random.default_rng(1).uniform(-20, 20, 300)
    low, high = getattr(interval, name)((x, x))
    np.testing.assert_allclose(low, high, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(
    ("function", "ends", "minimum", "largest"),
    [
        (interval.sin, (0.0, 4.0), np.sin(4.0), 1.0),
        (interval.sin, (2.0, 4.0), np.sin(4.0), np.sin(2.0)),
        (interval.cos, (3.0, 4.0), -1.0, np.cos(4.0)),
        (interval.cos, (-1.0, 0.5), np.cos(1.0), 1.0),
        (interval.cosh, (-1.0, 2.0), 1.0, np.cosh(2.0)),
        (interval.tanh, (-1.0, 2.0), np.tanh(-1.0), np.tanh(2.0)),
        (lambda a: interval.add_intervals(a, a), (-1.0, 2.0), -2.0, 4.0),
        (lambda a: interval.multiply_intervals(a, a), (-1.0, 2.0), -2.0, 4.0),
        (lambda a: interval.integer_power(a, 2), (-1.0, 2.0), 0.0, 4.0),
        (lambda a: interval.integer_power(a, 3), (-1.0, 2.0), -1.0, 8.0),
        (lambda a: interval.integer_power(a, -2), (1.0, 2.0), 0.25, 1.0),
        (lambda a: interval.integer_power(a, -1), (-2.0, -1.0), -1.0, -0.5),
        (lambda a: interval.integer_power(a, -1), (-1.0, 1.0), -np.inf, np.inf),
        (lambda a: interval.positive_part_power(a, 1.5), (-1.0, 4.0), 0.0, 8.0),
        (lambda a: interval.positive_part_power(a, 1.5), (-2.0, -1.0), 0.0, 0.0),
        (lambda a: interval.positive_part_power(a, 0.5), (1.0, 4.0), 1.0, 2.0),
        # powers that underflow keep their sign, and what overflows is infinite and never empty
        (lambda a: interval.integer_power(a, -3), (-1.0, -1e-200), -np.inf, -1.0),
        (lambda a: interval.integer_power(a, -3), (1e-200, 1.0), 1.0, np.inf),
        (lambda a: interval.integer_power(a, -3), (-1.0, 1.0), -np.inf, np.inf),
        (lambda a: interval.multiply_intervals(a, a), (1e300, 1e300), interval.MIN_OVERFLOW, np.inf),
    ],
)
def test_ranges_are_the_known_ones_up_to_rounding(function, ends, minimum, largest):
    """With extrema inside or not; nothing wider than rounding."""
    with np.errstate(all="ignore"):
        (low,), (high,) = function((np.array(ends[:1]), np.array(ends[1:])))
    assert low <= minimum
    assert largest <= high
    assert (low, high) == (pytest.approx(minimum, rel=1e-14), pytest.approx(largest, rel=1e-14))
