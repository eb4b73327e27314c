"""Guaranteed ranges of formulas: against known ranges, against samples, and where there are none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unilateral.atoms import X, Y
from unilateral.enclosure import SHARP, enclose, lower_bound
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
    lower, upper = lower_bound(formula, (X, Y), UNIT), -lower_bound(-formula, (X, Y), UNIT)
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
    assert max(-lower_bound(f, (X, Y), UNIT) for f in (formula, -formula)) == np.inf


def beyond(boxes):
    """The part x + y >= 1."""
    return boxes.sum(axis=1)[:, 1] >= 1, boxes.mean(axis=2).sum(axis=1) >= 1


def test_boxes_outside_do_not_count():
    formula = parse("x + y", ("x", "y"), "here")
    assert lower_bound(formula, (X, Y), UNIT) == pytest.approx(0, abs=1e-2)
    corner = lower_bound(formula, (X, Y), UNIT, beyond)
    assert 0.9 < corner <= 1


def test_samples_alone_would_not_do():
    """Control: a narrow well between the samples of a grid."""
    formula = parse("1 - 2*pos(1e-4 - (x - 0.14)**2, 1)*10000", ("x", "y"), "here")
    grid = np.linspace(0, 1, 33)
    assert compile_numpy([formula], (X, Y))(grid, grid)[0].min() == 1
    assert lower_bound(formula, (X, Y), UNIT) <= -1
