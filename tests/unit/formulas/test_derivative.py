"""Derivatives of formulas against those that SymPy finds, and against differences where there is a kink."""

import numpy as np
import pytest
import sympy

from unilateral.formulas.derivative import derivative
from unilateral.formulas.formula import compile_numpy, parse_formula

SMOOTH = [
    "x**3*y - 2*x*y**2 + 7",
    "sin(2*x + y)*cos(x*y)",
    "exp(x*y)/(2 + x**2)",
    "sinh(x)*cosh(x - y) + tanh(3*x*y)",
    "(x + y)**5/(1 + y**2)**2",
    "pi*x/3 - sqrt(2)*y",
    "sqrt(3 + x*y)*x - (2 + x)**(-1/3)",
    "5",
]
PLACES = np.random.default_rng(0).uniform(-1, 1, (2, 50))


@pytest.mark.parametrize("text", SMOOTH)
@pytest.mark.parametrize("name", ["x", "y"])
def test_the_derivative_is_what_sympy_finds(text: str, name: str) -> None:
    computed = compile_numpy([derivative(parse_formula(text, "xy", "here"), name)], "xy")(*PLACES)[0]
    x, y = sympy.symbols("x y", real=True)
    exact = sympy.lambdify(
        (x, y), sympy.diff(sympy.sympify(text, {"x": x, "y": y}), {"x": x, "y": y}[name]), "numpy"
    )
    assert np.allclose(computed, np.broadcast_to(exact(*PLACES), computed.shape), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "powers"), [("pos(x - y, 1)", 1), ("pos(x**2 - y, 2)*x", 2), ("pos(x, 5/2)", 2)]
)
def test_the_derivative_of_positive_parts_is_the_difference_quotient_off_the_kink(
    text: str, powers: int
) -> None:
    value = compile_numpy([parse_formula(text, "xy", "here")], "xy")
    computed = compile_numpy([derivative(parse_formula(text, "xy", "here"), "x")], "xy")(*PLACES)[0]
    h = 1e-6
    central = (value(PLACES[0] + h, PLACES[1])[0] - value(PLACES[0] - h, PLACES[1])[0]) / (2 * h)
    assert np.sum(np.abs(computed - central) > 1e-6) <= (powers == 1)


def test_equal_factors_become_a_power() -> None:
    """By hand: (s^3)'' = 6 s s'^2 + 3 s^2 s'', and s'^2 is enclosed closer than s' s'. Control: no s'."""
    f = parse_formula("pos((x - 1/3)*(2/3 - x), 3)", "x", "here")
    s = "(x - 1/3)*(2/3 - x)"
    by_hand = f"6*pos({s}, 1)*(1 - 2*x)**2 - 6*pos({s}, 2)"
    second = derivative(derivative(f, "x"), "x")
    assert second == parse_formula(by_hand, "x", "here")
    assert second != parse_formula(by_hand.replace("*(1 - 2*x)**2", ""), "x", "here")
