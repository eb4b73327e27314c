"""Interval arithmetic: known ranges, rounding against 40 digits, and what would be lost without it."""

import mpmath
import numpy as np
import pytest

from unilateral.formulas import interval

FUNCTIONS = {
    "sin": (interval.sin, mpmath.sin),
    "cos": (interval.cos, mpmath.cos),
    "exp": (interval.exp, mpmath.exp),
    "sinh": (interval.sinh, mpmath.sinh),
    "cosh": (interval.cosh, mpmath.cosh),
    "tanh": (interval.tanh, mpmath.tanh),
}


def exact(function, *arguments):
    """The value of 40 digits at numbers that are exact in floating point."""
    with mpmath.workdps(40):
        return function(*map(mpmath.mpf, arguments))


def holds(found, values):
    """Whether each of the values, with 40 digits, lies in its interval."""
    return [mpmath.mpf(a) <= value <= mpmath.mpf(b) for a, b, value in zip(*found, values, strict=True)]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_of_points_contain_the_value(name):
    """Against mpmath; control: points alone, not widened, do not contain it everywhere."""
    of, oracle = FUNCTIONS[name]
    x = np.random.default_rng(1).uniform(-20, 20, 300)
    values = [exact(oracle, float(each)) for each in x]
    low, high = of((x, x))
    assert all(holds((low, high), values))
    middle = 0.5 * (low + high)
    assert not all(holds((middle, middle), values))
    np.testing.assert_allclose(low, high, rtol=1e-13, atol=1e-14)


def test_sums_and_products_contain_the_value():
    """Against mpmath; control: as above."""
    a, b = np.random.default_rng(2).normal(size=(2, 300))
    for of, oracle in ((interval.total, mpmath.fadd), (interval.product, mpmath.fmul)):
        values = [exact(oracle, float(x), float(y)) for x, y in zip(a, b, strict=True)]
        found = of((a, a), (b, b))
        assert all(holds(found, values))
        middle = 0.5 * (found[0] + found[1])
        assert not all(holds((middle, middle), values))


def test_without_the_widening_a_value_lies_outside(monkeypatch):
    """1/10 + 2/10 is not the sum of the numbers next to them: 3/10 lies between two numbers."""
    tenths = [(np.array([k / 10]), np.array([k / 10])) for k in (1, 2)]
    with mpmath.workdps(40):
        value = [mpmath.mpf(0.1) + mpmath.mpf(0.2)]
    assert all(holds(interval.total(*tenths), value))
    monkeypatch.setattr(interval, "ULPS", 0)
    assert not all(holds(interval.total(*tenths), value))


@pytest.mark.parametrize(
    ("of", "ends", "least", "largest"),
    [
        (interval.sin, (0.0, 4.0), np.sin(4.0), 1.0),
        (interval.sin, (2.0, 4.0), np.sin(4.0), np.sin(2.0)),
        (interval.cos, (3.0, 4.0), -1.0, np.cos(4.0)),
        (interval.cos, (-1.0, 0.5), np.cos(1.0), 1.0),
        (interval.cosh, (-1.0, 2.0), 1.0, np.cosh(2.0)),
        (interval.tanh, (-1.0, 2.0), np.tanh(-1.0), np.tanh(2.0)),
        (lambda a: interval.power(a, 2), (-1.0, 2.0), 0.0, 4.0),
        (lambda a: interval.power(a, 3), (-1.0, 2.0), -1.0, 8.0),
        (lambda a: interval.power(a, -2), (1.0, 2.0), 0.25, 1.0),
        (lambda a: interval.power(a, -1), (-2.0, -1.0), -1.0, -0.5),
        (lambda a: interval.power(a, -1), (-1.0, 1.0), -np.inf, np.inf),
        (lambda a: interval.of_positive_part(a, 1.5), (-1.0, 4.0), 0.0, 8.0),
        (lambda a: interval.of_positive_part(a, 1.5), (-2.0, -1.0), 0.0, 0.0),
        (lambda a: interval.of_positive_part(a, 0.5), (1.0, 4.0), 1.0, 2.0),
    ],
)
def test_known_ranges(of, ends, least, largest):
    """With extrema inside or not; nothing wider than rounding."""
    with np.errstate(all="ignore"):
        (low,), (high,) = of((np.array(ends[:1]), np.array(ends[1:])))
    assert low <= least
    assert largest <= high
    assert (low, high) == (pytest.approx(least, rel=1e-14), pytest.approx(largest, rel=1e-14))


def test_powers_that_underflow_keep_their_sign():
    with np.errstate(all="ignore"):
        low, high = interval.power((np.array([-1.0, 1e-200, -1.0]), np.array([-1e-200, 1.0, 1.0])), -3)
    np.testing.assert_allclose(low, [-np.inf, 1, -np.inf])
    np.testing.assert_allclose(high, [-1, np.inf, np.inf])


def test_what_overflows_is_infinite_and_never_empty():
    with np.errstate(all="ignore"):
        (low,), (high,) = interval.product((np.array([1e300]), np.array([1e300])), (np.array([1e300]),) * 2)
    assert low <= interval.LARGE
    assert high == np.inf


@pytest.mark.parametrize("k", [9.0, 9.5, 99.5, 100.0])
def test_high_powers_contain_the_value(k, monkeypatch):
    """Each factor rounds; control: without that some lie outside."""
    x = np.random.default_rng(1).uniform(0.9, 1.1, 200)
    with mpmath.workdps(60):
        exact = [mpmath.mpf(float(each)) ** mpmath.mpf(k) for each in x]

    def outside():
        low, high = interval.of_positive_part((x, x), k)
        return sum(not a <= e <= b for a, b, e in zip(low.tolist(), high.tolist(), exact, strict=True))

    assert outside() == 0
    monkeypatch.setattr(interval, "PRODUCT", 0.0)
    monkeypatch.setattr(interval, "EXPONENT", 0.0)
    assert outside() > 0
