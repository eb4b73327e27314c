"""Taylor models: formulas against 40 digits at random points, their sharpness, and each bound's necessity."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from unilateral.formulas import taylor, taylor_functions
from unilateral.formulas.exact_numbers import apply
from unilateral.formulas.expression import atoms_in, variable
from unilateral.formulas.expression import number as exact
from unilateral.formulas.formula import parse
from unilateral.formulas.taylor import EPS, affine, basis, constant, joined, number
from unilateral.formulas.taylor_functions import evaluate, real_power
from unilateral.problems.atoms import X, Y

LEAVES = st.one_of(st.sampled_from(["x", "y", "pi"]), st.integers(-3, 3).map(lambda k: f"({k})"))
FORMULAS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda p: f"({p[0]}{p[1]}{p[2]})"),
        st.tuples(st.sampled_from(["sin", "cos", "exp", "sinh", "cosh", "tanh"]), inner).map(
            lambda p: f"{p[0]}({p[1]}/5)"
        ),
        st.tuples(inner, st.integers(0, 4)).map(lambda p: f"({p[0]})**{p[1]}"),
        st.tuples(inner, st.sampled_from(["0", "1", "3/2", "1/3"])).map(lambda p: f"pos({p[0]}, {p[1]})"),
    ),
    max_leaves=6,
)
IN_40_DIGITS = {"pos": lambda a, k: a**k if a > 0 else mpmath.mpf(0)}


def box(order, centre, arms):
    """x and y on one box each, affine in sigma: centre (2,), arms (2, 2)."""
    found = []
    for c, of in zip(centre, np.asarray(arms, dtype=float), strict=True):
        size, at = np.abs(of).sum(), np.array([c])
        found.append(affine(basis(2, order), at, of[:, None], (at - size, at + size)))
    return dict(zip("xy", found, strict=True))


def outside(text, centre, arms, order=4, points=12, seed=0):
    """By how much values with 40 digits, of what sympy reads, lie beyond the model; at most 0."""
    model = evaluate(parse(text, ("x", "y"), "here"), box(order, centre, arms))
    names = {"x": X, "y": Y, "pos": sympy.Function("pos")}
    value = sympy.lambdify((X, Y), sympy.sympify(text, names), [IN_40_DIGITS, "mpmath"])
    rng, worst = np.random.default_rng(seed), -mpmath.inf
    sigma = np.concatenate([rng.uniform(-1, 1, (points, 2)), [[1, 1], [1, -1], [-1, 1], [-1, -1]]])
    with mpmath.workdps(40):
        c = [mpmath.mpf(float(each)) for each in model.c[:, 0]]
        for s, t in sigma.tolist():
            x, y = (
                mpmath.mpf(float(m)) + mpmath.mpf(a[0]) * s + mpmath.mpf(a[1]) * t
                for m, a in zip(centre, np.asarray(arms).tolist(), strict=True)
            )
            p = mpmath.fsum(
                ci * mpmath.mpf(s) ** int(i) * mpmath.mpf(t) ** int(j)
                for ci, (i, j) in zip(c, model.basis.exponents, strict=True)
            )
            f = value(x, y)
            low, high = (mpmath.mpf(float(each[0])) for each in model.range)
            worst = max(worst, abs(f - p) - mpmath.mpf(float(model.rad[0])), low - f, f - high)
    return float(worst)


@settings(max_examples=80, deadline=None, derandomize=True)
@given(FORMULAS, st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_no_value_lies_outside(text, numbers):
    """Of any formula, against mpmath."""
    assert outside(text, numbers[:2], np.reshape(numbers[2:], (2, 2)) / 4) <= 0


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


@pytest.mark.parametrize("text", FEW)
def test_every_function_on_boxes_of_every_size(text):
    """Down to points, where all that is left is rounding: a few units in the last place of the terms."""
    for size in (0.3, 1e-2, 1e-5, 0.0):
        arms = size * np.array([[1.0, 0.3], [-0.2, 0.7]])
        assert outside(text, (0.31, 0.52), arms) <= 0
    model = evaluate(parse(text, ("x", "y"), "here"), box(4, (0.31, 0.52), np.zeros((2, 2))))
    assert model.rad[0] <= 1e3 * EPS * max(1.0, 10_000 * (text == FEW[-1]))


@pytest.mark.parametrize("text", FEW)
def test_the_remainder_falls_with_the_order(text):
    """By a factor of 2^(n + 1) for half of the box, less the rounding."""
    formula = parse(text, ("x", "y"), "here")
    arms = 0.02 * np.array([[1.0, 0.3], [-0.2, 0.7]])
    for order in (2, 4):
        coarse, fine = (evaluate(formula, box(order, (0.31, 0.52), k * arms)).rad[0] for k in (1, 0.5))
        assert fine <= 1.1 * coarse / 2 ** (order + 1) + 1e-10


def last_times(factor, own):
    """The same sequence with its last member spoilt."""

    def found(*arguments):
        values = own(*arguments)
        values[-1] *= factor
        return values

    return found


SMALLER = {
    "the last term of exp": (
        taylor_functions,
        "_factorials",
        last_times(2.5, taylor_functions._factorials),
        "exp(3*x)",
    ),
    "the last term of sin": (
        taylor_functions,
        "_factorials",
        last_times(2.5, taylor_functions._factorials),
        "sin(3*x)",
    ),
    "the last term of a power": (
        taylor_functions,
        "_binomials",
        last_times(0.4, taylor_functions._binomials),
        "pos(x + 1/2, 3/2)",
    ),
    "Cauchy's estimate of tanh": (taylor_functions, "AROUND_TANH", 0.01, "tanh(2*x)"),
    "rounding": (taylor, "EPS", 0.0, "x/3 + 1/7"),
}


@pytest.mark.parametrize("name", SMALLER)
def test_with_a_smaller_constant_a_value_lies_outside(monkeypatch, name):
    """Each bound is needed: factorials 2.5 times too large, binomials 2.5 times too small, no rounding."""
    module, attribute, smaller, text = SMALLER[name]
    arms = (1e-9 if name == "rounding" else 0.2) * np.eye(2)
    centres = [(float(c), 0.1) for c in np.linspace(0.05, 0.8, 7)]
    assert all(outside(text, c, arms) <= 0 for c in centres)
    monkeypatch.setattr(module, attribute, smaller)
    if name == "rounding":
        monkeypatch.setattr(taylor, "TINY", 0.0)
        monkeypatch.setattr(taylor.interval, "ULPS", 0)
    assert any(outside(text, c, arms) > 0 for c in centres)


@pytest.mark.parametrize(("beta", "omega"), [(0.05, np.pi), (1.5, np.pi), (2 / 3, 1.5 * np.pi), (12.0, 0.2)])
def test_the_harmonic_power(beta, omega):
    """Against mpmath, on boxes along both sides of the angle, near its vertex and at it."""
    phase, worst, mp = 0.3, [], mpmath.mpf
    for angle in (0.0, 0.4 * omega, omega):
        direction = np.array([np.cos(angle), np.sin(angle)])
        for r in (1.0, 1e-3, 0.0):
            half = 0.3 * r or 1e-3
            x, y = box(4, r * direction, half * np.outer(direction, [1, 0])).values()
            model = real_power(x, y, beta, phase, omega)
            for s in np.linspace(-1 if r else 0, 1, 9).tolist():
                with mpmath.workdps(40):
                    f = (mp(r) + mp(half) * s) ** mp(beta) * mpmath.cos(mp(beta) * (mp(angle) - mp(phase)))
                    powers = [mp(s) ** int(i) * (j == 0) for i, j in model.basis.exponents]
                    p = mpmath.fsum(mp(float(c)) * q for c, q in zip(model.c[:, 0], powers, strict=True))
                    worst.append(float(abs(f - p) - mp(float(model.rad[0]))))
    assert max(worst) <= 0


def test_a_jump_has_the_value_that_is_given_or_both():
    f, models = parse("3*pos(x - y, 0) + x", ("x", "y"), "here"), box(4, (0.5, 0.5), 0.1 * np.eye(2))
    (step,) = atoms_in(f, "pos")
    both, one, unknown = (
        evaluate(f, models, steps) for steps in (None, {step: np.array([1.0])}, {step: np.array([np.nan])})
    )
    assert [both.range[0][0], both.range[1][0]] == pytest.approx([0.4, 3.6])
    assert (one.c[0, 0], one.rad[0]) == (pytest.approx(3.5), pytest.approx(0, abs=1e-14))
    assert [unknown.range[0][0], unknown.range[1][0]] == pytest.approx([0.4, 3.6])


def test_models_that_are_not_finite_know_it():
    """A pole in the box: no polynomial, no range."""
    for text in ("1/x", "1/(x - y)**2", "exp(1000*x)**9*x"):
        model = evaluate(parse(text, ("x", "y"), "here"), box(4, (0.5, 0.5), np.eye(2)))
        assert model.rad[0] == np.inf
        assert not (np.isfinite(model.range[0][0]) and np.isfinite(model.range[1][0]))


@pytest.mark.parametrize(("d", "n", "runs"), [(1, 7, 8), (2, 4, 31), (3, 3, None)])
def test_a_basis_knows_all_products_of_its_monomials(d, n, runs):
    """Exponents add; in one variable a run per monomial, in two one per degree of the other, but for 1."""
    of = basis(d, n)
    found = [
        (a, b, c)
        for a, times in enumerate(of.times)
        for others, into in times
        for b, c in zip(range(len(of.degree))[others], range(len(of.degree))[into], strict=True)
    ]
    degree = of.degree
    assert sorted(found) == [
        (a, b, np.flatnonzero((of.exponents == of.exponents[a] + of.exponents[b]).all(axis=1)).item())
        for a in range(len(degree))
        for b in range(len(degree))
        if degree[a] + degree[b] <= n
    ]
    assert runs is None or sum(map(len, of.times)) == runs


def test_models_are_joined_in_the_boxes_order():
    of = basis(1, 2)
    whole = constant(of, (np.arange(5.0), np.arange(5.0)))
    odd, even = np.array([1, 3]), np.array([0, 2, 4])
    found = joined([(whole.on(odd), odd), (whole.on(even), even)])
    np.testing.assert_array_equal(found.c, whole.c)
    assert number(whole, 1 / 3).rad.shape == (5,)


@pytest.mark.parametrize("x", [1e-200, 1e-100, 1e-3, 1e100])
def test_fractional_exponents_are_rounded(x):
    """float(1/3) is not 1/3, which counts log x times: |f - p| was 3.4 times the remainder."""
    model = evaluate(apply("pos", variable("x"), exact(Fraction(1, 3))), box(4, (x, 0.0), np.zeros((2, 2))))
    with mpmath.workdps(40):
        f = mpmath.mpf(x) ** (mpmath.mpf(1) / 3)
        assert abs(f - mpmath.mpf(float(model.c[0, 0]))) <= mpmath.mpf(float(model.rad[0]))
        assert mpmath.mpf(float(model.range[0][0])) <= f <= mpmath.mpf(float(model.range[1][0]))
