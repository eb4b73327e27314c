"""Values by arb (python-flint): balls, whose precision is raised until a bound certainly holds or fails."""

import math
from fractions import Fraction

import numpy as np
import sympy
from flint import arb, ctx, fmpq
from symbolic import pos

from unilateral.formulas.taylor import affine_model, monomial_basis

PRECISIONS = (128, 512, 2048, 8192)
"""Bits."""
ctx.prec = PRECISIONS[0]
FUNCTIONS = {
    sympy.exp: arb.exp,
    sympy.log: arb.log,
    sympy.sin: arb.sin,
    sympy.cos: arb.cos,
    sympy.sinh: arb.sinh,
    sympy.cosh: arb.cosh,
    sympy.tanh: arb.tanh,
}


def exact(number):
    """A rational or a floating-point number."""
    return arb(fmpq(*Fraction(number).as_integer_ratio()))


def positive_power(a, k):
    """a_+^k; all that it may be where the ball a has both signs."""
    if a > 0:
        return a**k
    if a <= 0:
        return arb(0)
    return arb(0).union(abs(a) ** k if k > 0 else arb(1)) if k >= 0 else arb("nan")


def value(e, place):
    """That of a formula, `at` the values of its variables, to which those of its parts are added."""
    if e not in place:
        place[e] = _value(e, place)
    return place[e]


def _value(e, place):
    if e.is_Rational:
        return arb(fmpq(int(e.p), int(e.q)))
    if e is sympy.pi:
        return arb.pi()
    if e is sympy.E:
        return arb(1).exp()
    args = [value(argument, place) for argument in e.args]
    if e.is_Add:
        return sum(args[1:], args[0])
    if e.is_Mul:
        return math.prod(args)
    if e.is_Pow:
        return args[0] ** args[1]
    return positive_power(*args) if e.func is pos else FUNCTIONS[e.func](*args)


def polynomial(c, exponents, sigma):
    """The sum of c (m,) times monomials with those exponents (m, d) at sigma (d,)."""
    total = arb(0)
    for coefficient, powers in zip(c, exponents, strict=True):
        if coefficient:
            total += math.prod(arb(s) ** k for s, k in zip(sigma, powers, strict=True)) * coefficient
    return total


def certain(question, *arguments):
    """What a function answers, None while it does not know, at the first precision that suffices.

    None if there is none: a number lies on a bound, or is not defined.
    """
    try:
        for ctx.prec in PRECISIONS:
            answer = question(*arguments)
            if answer is not None:
                return answer
        return None
    finally:
        ctx.prec = PRECISIONS[0]


def between(lower, number, upper):
    """Whether a ball lies between two floating-point numbers; None if that is not known."""
    if not number.is_finite():
        return None
    if (lower > -np.inf and number < lower) or (upper < np.inf and number > upper):
        return False
    return True if (lower == -np.inf or number >= lower) and (upper == np.inf or number <= upper) else None


def holds(model, j, sigma, f):
    """Whether a value f at sigma is in the model's range and within its remainder; None if not known."""
    low = float(model.range[0][j])
    high = float(model.range[1][j])
    rad = float(model.rad[j])
    p = polynomial(model.c[:, j].tolist(), model.basis.exponents.tolist(), sigma)
    answers = between(low, f, high), between(-rad, f - p, rad)
    return False if False in answers else (None if None in answers else True)


def box(order, centre, arms):
    """The models of x and y on one box each, affine in sigma: centre (2,), arms (2, 2)."""
    models = []
    for c, arm in zip(centre, np.asarray(arms, dtype=float), strict=True):
        size = np.abs(arm).sum()
        values = np.array([c])
        models.append(
            affine_model(monomial_basis(2, order), values, arm[:, None], (values - size, values + size))
        )
    return dict(zip("xy", models, strict=True))
