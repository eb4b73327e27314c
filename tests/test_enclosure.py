"""Guaranteed ranges of formulas: against known ranges, against samples, and where there are none."""

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from unilateral.atoms import X, Y
from unilateral.enclosure import MOST_PIECES, SHARP, enclose, least_value, linear_pieces
from unilateral.expression import compile_numpy, parse

UNIT = np.array([[0.0, 1.0], [0.0, 1.0]])
LEAVES = st.one_of(st.sampled_from(["x", "y", "pi"]), st.integers(-3, 3).map(lambda k: f"({k})"))
FORMULAS = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda p: f"({p[0]}{p[1]}{p[2]})"),
        st.tuples(st.sampled_from(["sin", "cos", "exp", "sinh", "cosh", "tanh"]), inner).map(
            lambda p: f"{p[0]}({p[1]}/5)"
        ),
        st.tuples(inner, st.integers(0, 4)).map(lambda p: f"({p[0]})**{p[1]}"),
        st.tuples(inner, st.sampled_from(["0", "1", "3/2"])).map(lambda p: f"pos({p[0]}, {p[1]})"),
    ),
    max_leaves=6,
)


@pytest.mark.parametrize(
    ("text", "least", "largest"),
    [
        ("x*(1 - x)", 0, 1 / 4),
        ("sin(7*x)", -1, 1),
        ("cos(x - y)", np.cos(1), 1),
        ("(x - 1/2)**2 - (y - 1/3)**4", -((2 / 3) ** 4), 1 / 4),
        ("1/(x**2 - x + 1)", 1, 4 / 3),
        ("exp(-3*x)*y", 0, 1),
        ("pos(x - 1/2, 0)", 0, 1),
        ("pos(x - y, 3/2) - pos(y - x, 1)", -1, 1),
        ("cosh(2*x - 1) + tanh(y) + sinh(-y)", 1 + np.tanh(1) - np.sinh(1), np.cosh(1)),
        ("1e-150*x - 5e-150", -5e-150, -4e-150),
        ("7", 7, 7),
    ],
)
def test_known_ranges(text, least, largest):
    """Below the least value, by no more than the stated sharpness."""
    formula = parse(text, ("x", "y"), "here")
    lower, upper = least_value(formula, (X, Y), UNIT)[0], -least_value(-formula, (X, Y), UNIT)[0]
    slack = 40 * SHARP * (largest - least) + 1e-8 * abs(least)
    assert least - slack <= lower <= least
    assert largest <= upper <= largest + slack


@settings(max_examples=60, deadline=None, derandomize=True)
@given(FORMULAS, st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_no_value_lies_outside(text, corners):
    formula = parse(text, ("x", "y"), "here")
    limits = np.sort(np.reshape(corners, (2, 2)), axis=1)
    lower, upper = enclose(formula, {X: limits[:1], Y: limits[1:]})
    at = np.random.default_rng(1).uniform(*limits.T, size=(200, 2)).T
    values = compile_numpy([formula], (X, Y))(*at)[0]
    slack = 1e-13 * np.abs(values)
    assert np.all((lower - slack <= values) & (values <= upper + slack))


@pytest.mark.parametrize("text", ["1/x", "1/(x - 1/3)", "1/(x - y)**2", "exp(1000*x)**9", "x/(y - 1/7)"])
def test_an_unbounded_formula_has_an_infinite_bound(text):
    """Samples would hardly find it."""
    formula = parse(text, ("x", "y"), "here")
    assert max(-least_value(f, (X, Y), UNIT)[0] for f in (formula, -formula)) == np.inf


def beyond(boxes):
    """The part x + y >= 1."""
    return boxes.sum(axis=1)[:, 1] >= 1, boxes.mean(axis=2).sum(axis=1) >= 1


def test_boxes_outside_do_not_count():
    formula = parse("x + y", ("x", "y"), "here")
    assert least_value(formula, (X, Y), UNIT)[0] == pytest.approx(0, abs=1e-2)
    corner = least_value(formula, (X, Y), UNIT, beyond)[0]
    assert 0.9 < corner <= 1


def test_samples_alone_would_not_do():
    """Control: a narrow well between the samples of a grid."""
    formula = parse("1 - 2*pos(1e-4 - (x - 0.14)**2, 1)*10000", ("x", "y"), "here")
    grid = np.linspace(0, 1, 33)
    assert compile_numpy([formula], (X, Y))(grid, grid)[0].min() == 1
    assert least_value(formula, (X, Y), UNIT)[0] <= -1


def test_a_negative_power_of_a_positive_part_falls():
    """pos(x, -1/2) = x^(-1/2) on (0, 1], and 0 below."""
    formula = 2 * parse("pos(x, 3/2)", ("x",), "here").diff(X).diff(X)
    boxes = np.array([[-2.0, -1.0], [-1.0, 0.25], [0.25, 1.0]])
    lower, upper = enclose(formula, {X: boxes})
    assert lower == pytest.approx([0, 0, 1.5], rel=1e-12, abs=1e-300)
    assert upper == pytest.approx([0, np.inf, 3], rel=1e-12, abs=1e-300)


def deviation(formula, ends):
    """The most by which the formula differs from its linear interpolant, at 100 points of each piece."""
    at = ends[:-1, None] + np.diff(ends)[:, None] * np.linspace(0, 1, 100)
    values = compile_numpy([formula], (X,))(at)[0]
    linear = values[:, :1] + (values[:, -1:] - values[:, :1]) * np.linspace(0, 1, 100)
    return np.abs(values - linear).max()


@pytest.mark.parametrize(
    ("text", "kinks"),
    [
        ("4*exp(-((x - 3/10)*1000)**2)", []),
        ("sin(20*x)", []),
        ("pos(x - 1/3, 1)*exp(x) + pos(1/2 - x, 3/2)", [1 / 3, 1 / 2]),
        ("pos(x + 1, 0)*x**2", []),
    ],
)
def test_pieces_are_linear_up_to_the_tolerance(text, kinks):
    """Against samples; control: on pieces four times as long the formula is not."""
    formula = parse(text, ("x",), "here")
    ends = linear_pieces(formula, X, np.array([0, *kinks, 1]), lambda lengths: 0.01 + 0 * lengths)
    assert np.all(np.isin([0, *kinks, 1], ends))
    assert deviation(formula, ends) <= 0.01
    assert deviation(formula, np.append(ends[:-1:4], 1)) > 0.01


def test_a_straight_line_is_one_piece():
    assert linear_pieces(3 * X - 1, X, np.array([0.0, 1.0]), lambda lengths: 1e-9 + 0 * lengths).tolist() == [
        0,
        1,
    ]


@pytest.mark.parametrize("text", ["sin(100000*x)", "exp(-((x - 3/10)*10**12)**2)"])
def test_what_takes_too_many_pieces_is_refused(text):
    """By their number, and by their length."""
    formula = parse(text, ("x",), "here")
    with pytest.raises(ValueError, match=f"varies faster than {MOST_PIECES} pieces can resolve"):
        linear_pieces(formula, X, np.array([0.0, 1.0]), lambda lengths: 0.01 + 0 * lengths)


@pytest.mark.parametrize(("power", "place"), [(2, 100), (4, 20)])
def test_a_bound_is_sharp_where_terms_cancel(power, place):
    """(x - a)^p on [a, a + 1], expanded: the least value is 0, by the mean value theorem nearly so."""
    formula = sympy.expand((X - place) ** power)
    bound, met = least_value(formula, (X,), np.array([[place, place + 1.0]]))
    assert -2 * SHARP <= bound <= 0 <= met <= 2 * SHARP
    bound, met = least_value(-formula, (X,), np.array([[place, place + 1.0]]))
    assert -1 - 2 * SHARP <= bound <= -1 <= met <= -1 + 2 * SHARP


def test_powers_that_underflow_keep_their_sign():
    formula = 1 / (X**2 + sympy.Float("1e-100")) ** 4
    (lower,), (upper,) = enclose(formula, {X: np.array([[0.0, 1.0]])})
    assert (lower, upper) == (pytest.approx(1), np.inf)
    lower, upper = enclose(1 / X**3, {X: np.array([[-1.0, -1e-200], [1e-200, 1.0], [-1.0, 1.0]])})
    np.testing.assert_allclose(lower, [-np.inf, 1, -np.inf])
    np.testing.assert_allclose(upper, [-1, np.inf, np.inf])
