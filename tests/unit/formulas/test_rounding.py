"""What each operation adds to a Taylor model: its rounding against rational numbers, its remainder term."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from unilateral.formulas import taylor, taylor_functions
from unilateral.formulas.taylor import Model, affine, basis

BOXES = 50


def exact_model(degree, seed):
    """Polynomials of that degree on BOXES boxes, known exactly, in a basis of degree 4."""
    of, rng = basis(2, 4), np.random.default_rng(seed)
    c = rng.standard_normal((len(of.degree), BOXES)) * (of.degree <= degree)[:, None]
    most = np.abs(c).sum(axis=0)
    return Model(of, c, np.zeros(BOXES), (-2 * most, 2 * most))


def rational(model, box):
    """The coefficients on a box by exponents."""
    return {
        tuple(a): Fraction(float(c))
        for a, c in zip(model.basis.exponents.tolist(), model.c[:, box], strict=True)
    }


def added(a, b):
    return {key: a[key] + b[key] for key in a}


def multiplied(a, b):
    found = dict.fromkeys(a, Fraction(0))
    for (i, j), x in a.items():
        for (k, m), y in b.items():
            if x and y:
                found[i + k, j + m] += x * y
    return found


OPERATIONS = {
    "sum": (lambda a, b: a + b, added),
    "product": (lambda a, b: a * b, multiplied),
    "a third": (lambda a, b: a.scaled(1 / 3), lambda a, b: {key: x / 3 for key, x in a.items()}),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_the_rounding_of_coefficients_is_in_the_remainder(name, monkeypatch):
    """Of polynomials that are known exactly, so that nothing else is. Control: without EPS it is not.

    The sum of what rounding does to all coefficients is what the polynomial may be off by.
    """
    of, oracle = OPERATIONS[name]
    a, b = exact_model(2, 1), exact_model(2, 2)

    def outside():
        found = of(a, b)
        for box in range(BOXES):
            exact, rounded = oracle(rational(a, box), rational(b, box)), rational(found, box)
            yield sum(abs(exact[key] - rounded[key]) for key in exact) > Fraction(float(found.rad[box]))

    assert not any(outside())
    monkeypatch.setattr(taylor, "EPS", 0.0)
    assert any(outside())


FUNCTIONS = {
    "exp": (taylor_functions.exp, mpmath.exp),
    "sin": (taylor_functions.FUNCTIONS["sin"], mpmath.sin),
    "sinh": (taylor_functions.FUNCTIONS["sinh"], mpmath.sinh),
    "cosh": (taylor_functions.FUNCTIONS["cosh"], mpmath.cosh),
    "tanh": (taylor_functions.tanh, mpmath.tanh),
    "1/a**3": (lambda a: taylor_functions.power(a, -3), lambda a: a**-3),
    "pos(a, 5/2)": (lambda a: taylor_functions.positive_power(a, 2.5), lambda a: a ** mpmath.mpf("2.5")),
}


def beyond(model, value, centre, arm, sigma):
    """(k,) by how much the values with 40 digits at centre + arm sigma leave the models of one variable."""
    found = []
    with mpmath.workdps(40):
        for box, (c, a, s) in enumerate(zip(centre.tolist(), arm.tolist(), sigma.tolist(), strict=True)):
            p = mpmath.polyval([mpmath.mpf(float(each)) for each in model.c[::-1, box]], mpmath.mpf(s))
            f = value(mpmath.mpf(c) + mpmath.mpf(a) * mpmath.mpf(s))
            found.append(float(abs(f - p) - mpmath.mpf(float(model.rad[box]))))
    return np.array(found)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_rounding_of_a_function_at_a_point_is_in_the_remainder(name):
    """Of arguments that are known exactly, against mpmath; control: their values are not known exactly."""
    of, value = FUNCTIONS[name]
    centre = np.random.default_rng(3).uniform(0.2, 3.0, 200)
    point = Model(basis(1, 4), np.vstack([centre, np.zeros((4, 200))]), np.zeros(200), (centre, centre))
    found = of(point)
    assert beyond(found, value, centre, 0 * centre, 0 * centre).max() <= 0
    exact = Model(found.basis, found.c, np.zeros(200), found.range)
    assert beyond(exact, value, centre, 0 * centre, 0 * centre).max() > 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_remainder_is_that_of_the_whole_box(name):
    """At the ends of boxes, against mpmath; one of the derivative at the centre would be too small."""
    of, value = FUNCTIONS[name]
    centre = np.linspace(0.7, 3.0, 40)
    arm = 0.6 * np.minimum(centre, 1.0)
    found = of(affine(basis(1, 4), centre, arm[None], (centre - arm, centre + arm)))
    for sigma in (-1.0, 1.0):
        assert beyond(found, value, centre, arm, np.full(40, sigma)).max() <= 0


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_power_of_a_positive_part_holds_beyond_its_kink(k):
    """pos(x, k) on [-0.1, 0.5] is x^k, but 0 for x < 0, where x^k is up to 0.1^k in size."""
    centre, arm = np.array([0.2]), np.array([0.3])
    found = taylor_functions.positive_power(
        affine(basis(1, 4), centre, arm[None], (centre - arm, centre + arm)), k
    )
    assert found.rad[0] < 0.4**k
    for sigma in (-1.0, -0.8, 0.0, 1.0):
        value = beyond(found, lambda x: max(x, mpmath.mpf(0)) ** k, centre, arm, np.array([sigma]))
        assert value.max() <= 0


def test_places_that_are_rounded_are_known_up_to_that():
    """x = 1/2 + sigma/4 up to 1e-3: both 1/2 and 1/2 + 1e-3 are values at sigma = 0."""
    centre, arms = np.array([0.5]), np.array([[0.25]])
    found = affine(basis(1, 4), centre, arms, (centre - 0.251, centre + 0.251), rounding=1e-3)
    assert found.rad[0] >= 1e-3
    assert found.range[1][0] >= 0.751


def test_the_rounding_of_an_exponent_counts_the_logarithm():
    """The cube root of numbers up to 1e300, their logarithm 690: 1/3, rounded, changes it by 1e-14."""
    centre = np.logspace(200, 300, 50)
    point = Model(basis(1, 4), np.vstack([centre, np.zeros((4, 50))]), np.zeros(50), (centre, centre))
    found = taylor_functions.positive_power(point, 1 / 3)
    assert beyond(found, lambda a: a ** (mpmath.mpf(1) / 3), centre, 0 * centre, 0 * centre).max() <= 0
    assert np.all(found.rad <= 1e-11 * found.c[0])
