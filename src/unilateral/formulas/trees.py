"""Formulas as nested lists for files, and back: the same terms in the same order, which no text promises.

>>> from unilateral.formulas.formula import parse
>>> e = parse("x*sin(y)**2/3 - 1", ("x", "y"), "e")
>>> of_tree(tree(e)) == e
True
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from unilateral.formulas.expression import Atom, Expression


def tree(of: Expression) -> list[Any]:
    """The terms: each a list of powers, a base with its exponent, and the term's number."""
    return [[[[_base(base), str(k)] for base, k in powers], str(c)] for powers, c in of.terms]


def of_tree(given: list[Any]) -> Expression:
    """The formula with that `tree`."""
    return Expression(
        tuple(
            (tuple((_of_base(base), Fraction(k)) for base, k in powers), Fraction(c)) for powers, c in given
        )
    )


def _base(of: Atom | Expression) -> Any:
    if isinstance(of, Expression):
        return tree(of)
    return {"name": of.name, "args": [tree(arg) for arg in of.args]}


def _of_base(given: Any) -> Atom | Expression:
    if isinstance(given, list):
        return of_tree(given)
    return Atom(given["name"], tuple(of_tree(arg) for arg in given["args"]))
