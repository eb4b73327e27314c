"""Where steps of f are in the units of k and c."""

import numpy as np
import pytest
import sympy

import unilateral as ul
from unilateral.problems import scaled as module
from unilateral.problems.scaled import scaled

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.mark.parametrize(
    ("step", "places"),
    [
        (
            "1/16 - (x - 1/4)**2 - (y - 3/8)**2",
            [(1 / 2, 3 / 8), (1 / 4, 5 / 8), (0, 3 / 8), (2 / 5, 23 / 40)],
        ),
        ("2*x - 3*y - 1/2", [(1 / 4, 0), (1 / 2, 1 / 6), (1, 1 / 2)]),
    ],
)
@pytest.mark.parametrize(("k", "c", "length"), [(9, "1/4", 6), ("1/4", 25, 1 / 10)])
def test_a_step_is_at_the_same_curve_in_scaled_coordinates(step, places, k, c, length):
    """X = x / length, length = (k/c)^{1/2}: points on the circle, or line, by hand, are on the scaled one.

    Its inside is the same side, and distances are scaled. Control: without scaling they are not on it.
    """
    problem = ul.Problem(SQUARE, f=f"pos({step}, 0)", g=0, k=k, c=c)
    (kink,), places = scaled(problem).jumps.values(), np.array(places)
    assert kink.level(places / length) == pytest.approx(0, abs=1e-14)
    assert np.abs(kink.level(places)).max() > 0.1
    x, y = np.random.default_rng(1).random((2, 100))
    inside = eval(step, {"x": x, "y": y}) > 0
    assert (kink.sign * kink.level(np.column_stack([x, y]) / length) > 0).tolist() == inside.tolist()
    assert 0 < inside.sum() < 100


def test_the_least_value_that_counts_is_rounded_down(monkeypatch):
    """k^{1/2} times that of u, with 40 digits. Control: the nearest number is above it for some k."""
    monkeypatch.setattr(module, "enclose_obstacle", lambda polygon, model, free, least: least)
    above = 0
    for k in range(2, 40):
        problem = ul.Problem(SQUARE, f="x - 1/3", g=-1, k=k)
        of = scaled(problem)
        exact = sympy.sqrt(k).n(40) * sympy.Rational(of.of.least)
        assert sympy.Rational(of.enclosed_obstacle) <= exact
        above += bool(sympy.Rational(of.of.least / of.of.units.value) > exact)
    assert above > 0
