"""The real roots of polynomials: against sympy's, by hand, and none is missed or found twice."""

import math
import random
from fractions import Fraction

import pytest
import sympy

from unilateral.formulas.roots import real_roots


def product_of(*roots):
    """The coefficients of (x - r_1) .. (x - r_n)."""
    coefficients = [Fraction(1)]
    for root in roots:
        shifted = [Fraction(root) * c for c in coefficients]
        coefficients = [
            a - b for a, b in zip([*coefficients, Fraction(0)], [Fraction(0), *shifted], strict=True)
        ]
    return coefficients


def isolate_by_sympy(coefficients):
    """Isolated by sympy, and rounded from 40 digits."""
    polynomial = sympy.Poly([sympy.Rational(c) for c in coefficients], sympy.Symbol("x"))
    return sorted({float(root.evalf(40)) for root in sympy.real_roots(polynomial)})


def random_polynomials():
    """Some with rational roots, single and multiple, some with any."""
    rng = random.Random(47)
    for k in range(40):
        degree = rng.randint(1, 6)
        if k % 2:
            roots = [Fraction(rng.randint(-12, 12), rng.randint(1, 9)) for _ in range(degree)]
            yield product_of(*roots, *rng.choices(roots, k=rng.randint(0, 3)))
        else:
            leading = Fraction(rng.randint(1, 20), rng.randint(1, 9))
            yield [leading, *(Fraction(rng.randint(-20, 20), rng.randint(1, 9)) for _ in range(degree))]


def test_the_roots_are_those_that_sympy_finds():
    """To one unit in the last place. Control: of a polynomial plus 1 they are others."""
    for coefficients in random_polynomials():
        computed = real_roots(coefficients)
        expected = isolate_by_sympy(coefficients)
        assert len(computed) == len(expected), coefficients
        assert all(abs(a - b) <= math.ulp(b) for a, b in zip(computed, expected, strict=True)), coefficients
        assert not {*real_roots([*coefficients[:-1], coefficients[-1] + 1])} & {*computed}


@pytest.mark.parametrize(
    ("coefficients", "roots"),
    [
        (product_of(Fraction(1, 3), Fraction(1, 3), Fraction(1, 3)), [1 / 3]),
        (product_of(0, 0, -2, 5), [-2, 0, 5]),
        (product_of(0, 0, 0), [0]),
        (product_of(*range(1, 21)), [*range(1, 21)]),
        (product_of(1, 1 + Fraction(1, 1 << 40), 7), [1, 1 + 2**-40, 7]),
        (product_of(1, 1 + Fraction(1, 1 << 80), 7), [1, 1, 7]),
        ([Fraction(1), Fraction(0), Fraction(1), Fraction(0), Fraction(1)], []),
        ([Fraction(1), Fraction(0), Fraction(0), Fraction(-(10**900))], [1e300]),
        ([Fraction(1), Fraction(0), Fraction(0), Fraction(10**1200)], [-math.inf]),
        ([Fraction(10**300), Fraction(0), Fraction(-1), Fraction(0)], [-1e-150, 0, 1e-150]),
        ([Fraction(3)], []),
    ],
    ids=str,
)
def test_roots_are_those_by_hand_and_multiple_ones_once(coefficients, roots):
    """Multiple ones once, those that only exact arithmetic tells apart, and those beyond all floats."""
    assert real_roots(coefficients) == pytest.approx(roots, rel=1e-15, abs=0)
