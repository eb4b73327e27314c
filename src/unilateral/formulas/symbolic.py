"""Formulas as expressions of sympy: to derive the data of cases, and to evaluate numbers that cancel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import lru_cache, reduce
from operator import mul
from typing import Any

import sympy
from sympy.core.evalf import PrecisionExhausted
from sympy.core.function import ArgumentIndexError

from unilateral.formulas import formula, taylor_enclosures
from unilateral.formulas.exact_numbers import apply, sign
from unilateral.formulas.expression import Atom, Expression, number, total, variable
from unilateral.formulas.formula import Compiled
from unilateral.formulas.formula_walk import Evaluation
from unilateral.formulas.taylor import Model

DIGITS = 2000


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


def number_of(text: object, where: str) -> sympy.Expr:
    """A number of a data file, exactly. Raises InputError as `formula.number`."""
    return symbolic(formula.number(text, where))


def value(e: Expression, context: Any) -> Any:
    """The value of an expression without variables to 17 digits, as a number of a context of mpmath.

    Raises ArithmeticError where it is no real number, and ValueError where DIGITS digits do not
    distinguish it from 0.
    """
    exact = symbolic(e)
    if exact.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo, sympy.I):
        raise ArithmeticError("no real number")
    if exact.is_Rational:
        return context.mpf(int(exact.p)) / int(exact.q)
    try:
        close = exact.evalf(17, maxn=DIGITS, strict=True)
    except PrecisionExhausted:
        raise ValueError(f"'{exact}' cannot be distinguished from 0; write it as a single number") from None
    if not close.is_Float:
        raise ArithmeticError("no real number")
    return context.mpf(close)


class _Symbolic(Evaluation[sympy.Expr]):
    def number(self, value: Fraction) -> sympy.Expr:
        return sympy.Rational(value.numerator, value.denominator)

    def power(self, base: sympy.Expr, k: Fraction) -> sympy.Expr:
        return base ** self.number(k)

    def function(self, of: Atom) -> sympy.Expr:
        if of.args:
            function = pos if of.name == "pos" else getattr(sympy, of.name)
            return function(*(self.of(each) for each in of.args))
        return sympy.pi if of.name == "pi" else sympy.Symbol(of.name, real=True)


@lru_cache(maxsize=1024)
def symbolic(e: Expression) -> sympy.Expr:
    return _Symbolic((e,), {}).of(e)


@lru_cache(maxsize=4096)
def plain(e: sympy.Expr) -> Expression:
    """A formula of sympy as an `Expression`. Symbols become variables; floating-point numbers are exact."""
    if e.is_Rational or e.is_Float:
        return number(Fraction(*map(int, sympy.Rational(e).as_numer_denom())))
    if e.is_Symbol or e is sympy.pi:
        return variable(e.name if e.is_Symbol else "pi")
    if e is sympy.E:
        return apply("exp", number(1))
    args = [plain(each) for each in e.args]
    if e.is_Add:
        return total(term for each in args for term in each.terms)
    if e.is_Mul:
        return reduce(mul, args)
    if e.is_Pow:
        base, k = args
        return base ** (k.rational or 0)
    return apply(e.func.__name__, *args)


def evaluate(e: sympy.Expr, variables: Mapping[sympy.Symbol, Model]) -> Model:
    """A formula on the boxes of its variables' models."""
    return taylor_enclosures.evaluate(plain(e), {symbol.name: model for symbol, model in variables.items()})


def compile_numpy(formulas: Sequence[sympy.Expr], symbols: Sequence[sympy.Symbol]) -> Compiled:
    """As `formula.compile_numpy`."""
    return formula.compile_numpy([plain(e) for e in formulas], [symbol.name for symbol in symbols])


def kinks(e: sympy.Expr, symbol: sympy.Symbol) -> list[tuple[float, Fraction]]:
    """As `formula.kinks`."""
    return formula.kinks(plain(e), symbol.name)


def real_roots(coefficients: Sequence[Fraction]) -> list[float]:
    """The real roots of a polynomial, its coefficient of the highest power first; infinite if too large."""
    x = sympy.Symbol("x")
    of = sympy.Poly([sympy.Rational(c.numerator, c.denominator) for c in coefficients], x)
    return [float(root) for root in sympy.real_roots(of)]
