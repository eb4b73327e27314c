"""Derivatives of formulas, by the rules that everybody knows; pos(a, 1) has the derivative pos(a, 0) a'."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

from unilateral.formulas.exact_numbers import apply
from unilateral.formulas.expression import ONE, ZERO, Atom, Expression, Power, product

OUTER: dict[str, Callable[..., Expression]] = {
    "sin": lambda a: apply("cos", a),
    "cos": lambda a: -apply("sin", a),
    "exp": lambda a: apply("exp", a),
    "sinh": lambda a: apply("cosh", a),
    "cosh": lambda a: apply("sinh", a),
    "tanh": lambda a: 1 - apply("tanh", a) ** 2,
    "pos": lambda a, k: k * apply("pos", a, k - 1) if k.rational else ZERO,
}
"""The derivatives of functions by their first argument."""


def derivative(of: Expression, name: str) -> Expression:
    """The derivative of a formula without logarithms by the variable of that name."""
    return sum((_of_product(c, powers, name) for powers, c in of.terms), ZERO)


def _of_product(c: Fraction, powers: tuple[Power, ...], name: str) -> Expression:
    terms = []
    for i, (base, k) in enumerate(powers):
        if name in base.variables:
            # one product of all factors: equal ones become a power, whose enclosure is closer
            inner, inner_powers = _of_base(base, name).factors
            others = powers[:i] + powers[i + 1 :]
            terms.append(product(c * k * inner, [(base, k - 1), *others, *inner_powers]))
    return sum(terms, ZERO)


def _of_base(base: Atom | Expression, name: str) -> Expression:
    if isinstance(base, Expression):
        return derivative(base, name)
    return OUTER[base.name](*base.args) * derivative(base.args[0], name) if base.args else ONE
