"""Derivatives of formulas by the usual rules; pos(a, 1) has the derivative pos(a, 0) a', and a jump has 0."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from unilateral.formulas.exact_numbers import apply_function
from unilateral.formulas.expression import ONE, ZERO, Expression, Power, Primitive, multiply_powers

OUTER_DERIVATIVES: dict[str, Callable[..., Expression]] = {
    "sin": lambda a: apply_function("cos", a),
    "cos": lambda a: -apply_function("sin", a),
    "exp": lambda a: apply_function("exp", a),
    "sinh": lambda a: apply_function("cosh", a),
    "cosh": lambda a: apply_function("sinh", a),
    "tanh": lambda a: 1 - apply_function("tanh", a) ** 2,
    "pos": lambda a, k: k * apply_function("pos", a, k - 1) if k.rational else ZERO,
}
"""The derivatives of functions by their first argument."""


def derivative(formula: Expression, variable: str) -> Expression:
    """The derivative of a formula without logarithms by the variable of that name."""
    return sum((_derive_product(c, powers, variable) for powers, c in formula.terms), ZERO)


def _derive_product(c: Fraction, powers: tuple[Power, ...], variable: str) -> Expression:
    """The derivative of c times powers: the sum over b^k of c k b^(k - 1) b' times the other powers."""
    terms = []
    for i, (base, k) in enumerate(powers):
        if variable in base.variables:
            # one product of all factors: equal ones become a power, whose enclosure is closer
            inner, inner_powers = _derive_base(base, variable).factors
            other_powers = powers[:i] + powers[i + 1 :]
            terms.append(multiply_powers(c * k * inner, [(base, k - 1), *other_powers, *inner_powers]))
    return sum(terms, ZERO)


def _derive_base(base: Primitive | Expression, variable: str) -> Expression:
    """The derivative of what a power is taken of: a sum, a function, by the chain rule, or the variable."""
    if isinstance(base, Expression):
        return derivative(base, variable)
    return OUTER_DERIVATIVES[base.name](*base.args) * derivative(base.args[0], variable) if base.args else ONE
