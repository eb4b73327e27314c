"""Formulas as expressions of sympy, and back: the oracle of what `unilateral.formulas` derives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache, reduce
from operator import mul
from typing import Any

import mpmath
import sympy
from sympy.core.function import ArgumentIndexError

from unilateral.formulas import formula, taylor_enclosures
from unilateral.formulas.exact_numbers import apply_function, sign
from unilateral.formulas.expression import Expression, Primitive, rational_expression, sum_terms, variable
from unilateral.formulas.formula import CompiledFormulas
from unilateral.formulas.formula_walk import Evaluation
from unilateral.formulas.taylor import TaylorModel

X = sympy.Symbol("x", real=True)
Y = sympy.Symbol("y", real=True)
T = sympy.Symbol("t", real=True)
D = sympy.Symbol("d", real=True)
R = sympy.Symbol("r", real=True)
THETA = sympy.Symbol("theta", real=True)
"""The coordinates of the formulas of cases."""


class pos(sympy.Function):
    """max(a, 0)**k; for k = 0 the indicator of a > 0."""

    nargs = 2

    @classmethod
    def eval(cls, a: sympy.Expr, k: sympy.Expr) -> sympy.Expr | None:
        if a.is_number:
            return a**k if sign(plain(a)) > 0 else sympy.Integer(0)
        return None

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        a, k = self.args
        if argindex != 1 or k == 0:
            raise ArgumentIndexError(self, argindex)
        return k * pos(a, k - 1)


class _Symbolic(Evaluation[sympy.Expr]):
    def number(self, value: Fraction) -> sympy.Expr:
        return sympy.Rational(value.numerator, value.denominator)

    def power(self, base: sympy.Expr, k: Fraction) -> sympy.Expr:
        return base ** self.number(k)

    def function(self, primitive: Primitive) -> sympy.Expr:
        if primitive.args:
            function = pos if primitive.name == "pos" else getattr(sympy, primitive.name)
            return function(*(self.evaluate(item) for item in primitive.args))
        return sympy.pi if primitive.name == "pi" else sympy.Symbol(primitive.name, real=True)


@lru_cache(maxsize=1024)
def symbolic(e: Expression) -> sympy.Expr:
    """A formula of the project as one of sympy."""
    return _Symbolic((e,), {}).evaluate(e)


@lru_cache(maxsize=4096)
def plain(e: sympy.Expr) -> Expression:
    """A formula of sympy as an `Expression`. Symbols become variables; floating-point numbers are exact."""
    if e.is_Rational or e.is_Float:
        return rational_expression(Fraction(*map(int, sympy.Rational(e).as_numer_denom())))
    if e.is_Symbol or e is sympy.pi:
        return variable(e.name if e.is_Symbol else "pi")
    if e is sympy.E:
        return apply_function("exp", rational_expression(1))
    args = [plain(item) for item in e.args]
    if e.is_Add:
        return sum_terms(term for item in args for term in item.terms)
    if e.is_Mul:
        return reduce(mul, args)
    if e.is_Pow:
        base, k = args
        return base ** (k.rational or 0)
    return apply_function(e.func.__name__, *args)


def evaluate(e: sympy.Expr, variables: Mapping[sympy.Symbol, TaylorModel]) -> TaylorModel:
    """A formula on the boxes of its variables' models."""
    return taylor_enclosures.enclose_formula(
        plain(e), {symbol.name: model for symbol, model in variables.items()}
    )


def compile_numpy(formulas: Sequence[sympy.Expr], symbols: Sequence[sympy.Symbol]) -> CompiledFormulas:
    """As `formula.compile_numpy`."""
    return formula.compile_numpy([plain(e) for e in formulas], [symbol.name for symbol in symbols])


def compile_mpmath(e: sympy.Expr, *symbols: sympy.Symbol) -> Callable[..., Any]:
    """The formula as a function of mpmath's numbers, with as many digits as mpmath works with."""
    positive_part = {"pos": lambda a, k: a**k if a > 0 else mpmath.mpf(0)}
    return sympy.lambdify(symbols, e, [positive_part, "mpmath"])
