"""Taylor models: how sharp they are, what they say of kinks, jumps and poles, and the basis of monomials.

That no value lies outside is in test_against_arb.py.
"""

import numpy as np
import pytest
from balls import box, certain, exact, holds, positive_power

from unilateral.formulas import taylor_enclosures
from unilateral.formulas.expression import find_functions
from unilateral.formulas.formula import parse_formula
from unilateral.formulas.taylor import (
    EPS,
    affine_model,
    join_models,
    monomial_basis,
    number_model,
    range_model,
)
from unilateral.formulas.taylor_enclosures import enclose_formula, polar_power_model

FEW = [
    "exp(-9*x**2 - y)",
    "sin(5*x + y)*cos(3*y)",
    "tanh(4*x - y)",
    "1/(1 + x**2)**2",
    "sinh(2*x)*cosh(y - x)",
    "pos(x + 1, 7/3)",
    "(x + y)**9",
    "x**2 - 200*x*y + 10000",
]
ARMS = np.array([[1.0, 0.3], [-0.2, 0.7]])


@pytest.mark.parametrize("text", FEW)
def test_at_points_only_rounding_is_left(text):
    """A few units in the last place of the terms."""
    model = enclose_formula(parse_formula(text, ("x", "y"), "here"), box(4, (0.31, 0.52), 0 * ARMS))
    assert model.rad[0] <= 1e3 * EPS * max(1.0, 10_000 * (text == FEW[-1]))


@pytest.mark.parametrize("text", FEW)
def test_the_remainder_falls_with_the_order(text):
    """By a factor of 2^(n + 1) for half of the box, less the rounding."""
    formula = parse_formula(text, ("x", "y"), "here")
    for order in (2, 4):
        coarse = enclose_formula(formula, box(order, (0.31, 0.52), 0.02 * ARMS)).rad[0]
        fine = enclose_formula(formula, box(order, (0.31, 0.52), 0.01 * ARMS)).rad[0]
        assert fine <= 1.1 * coarse / 2 ** (order + 1) + 1e-10


@pytest.mark.parametrize(("beta", "omega"), [(0.05, np.pi), (1.5, np.pi), (2 / 3, 1.5 * np.pi), (12.0, 0.2)])
def test_the_harmonic_power_is_enclosed_at_and_near_the_vertex(beta, omega):
    """Against arb, on boxes along both sides of the angle, near its vertex and at it."""
    phase = 0.3
    for angle in (0.0, 0.4 * omega, omega):
        direction = np.array([np.cos(angle), np.sin(angle)])
        factor = (exact(beta) * (exact(angle) - exact(phase))).cos()
        for r in (1.0, 1e-3, 0.0):
            half = 0.3 * r or 1e-3
            x, y = box(4, r * direction, half * np.outer(direction, [1, 0])).values()
            model = polar_power_model(x, y, beta, phase, omega)
            for s in np.linspace(-1 if r else 0, 1, 9).tolist():
                f = positive_power(exact(r) + exact(half) * s, exact(beta)) * factor
                assert certain(holds, model, 0, [s, 0.0], f)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_a_power_of_a_positive_part_holds_beyond_its_kink(k):
    """pos(x, k) on [-0.1, 0.5] is x^k, but 0 for x < 0, where x^k is up to 0.1^k in size."""
    x = box(4, (0.2, 0.0), [[0.3, 0.0], [0.0, 0.0]])["x"]
    model = taylor_enclosures.positive_power_model(x, k)
    assert model.rad[0] < 0.4**k
    for s in (-1.0, -0.8, 0.0, 1.0):
        assert certain(holds, model, 0, [s, 0.0], positive_power(exact(0.2) + exact(0.3) * s, exact(k)))


def test_the_cube_root_of_large_numbers_is_sharp():
    """Of numbers up to 1e300, their logarithm 690: 1/3, rounded, changes it by 1e-14."""
    position = np.logspace(200, 300, 50)
    x = affine_model(monomial_basis(1, 4), position, np.zeros((1, 50)), (position, position))
    model = taylor_enclosures.positive_power_model(x, 1 / 3)
    assert np.all(model.rad <= 1e-11 * model.c[0])


def test_places_that_are_rounded_are_known_up_to_that():
    """x = 1/2 + sigma/4 up to 1e-3: both 1/2 and 1/2 + 1e-3 are values at sigma = 0."""
    centre = np.array([0.5])
    arms = np.array([[0.25]])
    model = affine_model(monomial_basis(1, 4), centre, arms, (centre - 0.251, centre + 0.251), rounding=1e-3)
    assert model.rad[0] >= 1e-3
    assert model.range[1][0] >= 0.751


def test_a_jump_has_the_value_that_is_given_or_both():
    f = parse_formula("3*pos(x - y, 0) + x", ("x", "y"), "here")
    models = box(4, (0.5, 0.5), 0.1 * np.eye(2))
    (step,) = find_functions(f, "pos")
    formula = enclose_formula(f, models, None)
    first = enclose_formula(f, models, {step: np.array([1.0])})
    unknown = enclose_formula(f, models, {step: np.array([np.nan])})
    assert [formula.range[0][0], formula.range[1][0]] == pytest.approx([0.4, 3.6])
    assert (first.c[0, 0], first.rad[0]) == (pytest.approx(3.5), pytest.approx(0, abs=1e-14))
    assert [unknown.range[0][0], unknown.range[1][0]] == pytest.approx([0.4, 3.6])


@pytest.mark.parametrize("text", ["1/x", "1/(x - y)**2", "exp(1000*x)**9*x"])
def test_models_that_are_not_finite_know_it(text):
    """A pole in the box: no polynomial, no range."""
    model = enclose_formula(parse_formula(text, ("x", "y"), "here"), box(4, (0.5, 0.5), np.eye(2)))
    assert model.rad[0] == np.inf
    assert not (np.isfinite(model.range[0][0]) and np.isfinite(model.range[1][0]))


@pytest.mark.parametrize(("d", "n", "runs"), [(1, 7, 8), (2, 4, 31), (3, 3, None)])
def test_a_basis_knows_all_products_of_its_monomials(d, n, runs):
    """Exponents add; in one variable a run per monomial, in two one per degree of the other, but for 1."""
    basis = monomial_basis(d, n)
    degree = basis.degrees
    exponents = basis.exponents
    products = [
        (a, b, c)
        for a, times in enumerate(basis.product_slices)
        for alternatives, into in times
        for b, c in zip(range(len(degree))[alternatives], range(len(degree))[into], strict=True)
    ]
    assert sorted(products) == [
        (a, b, np.flatnonzero((exponents == exponents[a] + exponents[b]).all(axis=1)).item())
        for a in range(len(degree))
        for b in range(len(degree))
        if degree[a] + degree[b] <= n
    ]
    assert runs is None or sum(map(len, basis.product_slices)) == runs


def test_models_are_joined_in_the_boxes_order():
    basis = monomial_basis(1, 2)
    full_range_model = range_model(basis, (np.arange(5.0), np.arange(5.0)))
    odd = np.array([1, 3])
    even = np.array([0, 2, 4])
    np.testing.assert_array_equal(
        join_models(
            [(full_range_model.select_boxes(odd), odd), (full_range_model.select_boxes(even), even)]
        ).c,
        full_range_model.c,
    )
    assert number_model(full_range_model, 1 / 3).rad.shape == (5,)
