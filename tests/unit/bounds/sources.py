"""f from formulas, as what is enclosed on meshes; means of polynomials on a triangle, exact."""

from math import factorial

from sympy import Poly, Rational
from sympy.abc import s, t

from unilateral.formulas.expression import find_functions
from unilateral.formulas.formula import compile_numpy, parse_formula
from unilateral.formulas.taylor_enclosures import enclose_formula
from unilateral.problems.problem import zero_curve

FORMULAS = [
    "sin(3*x)*(1 + y)",
    "exp(-40*((x - 0.3)**2 + (y - 0.6)**2))",
    "pos(x - 1/3, 1)*y",
    "pos(1/9 - (x - 1/2)**2 - (y - 1/2)**2, 1)*8",
    "pos(x - y/7 - 1/3, 1/2)",
    "pos(x - y/3 - 0.123, 0)*exp(x)",
    "pos(1/9 - (x - 0.52)**2 - (y - 0.47)**2, 0)*exp(x)",
    "pos(x - 0.31, 0)*pos(y - 0.47, 0) - pos(0.2 - x, 0)",
    "pos(x - pi/9, 0)*sqrt(1 + x**2 + x*y + y**2)",
]


HATS = [Poly(hat, s, t, domain="QQ") for hat in (1 - s - t, s, t)]
"""The barycentric coordinates of a triangle, in two of them."""


def mean(p):
    """Of a polynomial in two hats: that of s^a t^b is 2 a! b! / (a + b + 2)!."""
    return sum(x * Rational(2 * factorial(a) * factorial(b), factorial(a + b + 2)) for (a, b), x in p.terms())


class Source:
    """f from a formula."""

    def __init__(self, text):
        self.f = parse_formula(text, ("x", "y"), "here")
        steps = [power for power in find_functions(self.f, "pos") if power.args[1].rational == 0]
        self.jumps = {step: zero_curve(step.args[0])[0] for step in steps}
        self.value = compile_numpy([self.f], "xy")

    def model(self, x, y, steps):
        return enclose_formula(self.f, {"x": x, "y": y}, steps)


class Counted(Source):
    """f from a formula, which counts the pieces on which it is looked at."""

    pieces = 0

    def model(self, x, y, steps):
        self.pieces += len(x.rad)
        return super().model(x, y, steps)
