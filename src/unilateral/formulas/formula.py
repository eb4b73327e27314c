"""The one grammar for formulas in data files: a whitelist, parsed to sympy and never evaluated as code.

A formula has numbers (decimals are taken exactly), the constant pi, the variables its place allows,
+ - * / **, and the functions of `grammar`. `pos(a, k)` is the power a_+^k of the positive part, the only way
to write a kink or a singularity, so that both can be found again (see `kinks`).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import sympy
from sympy.simplify.cse_main import tree_cse

from unilateral.arrays import Array
from unilateral.errors import InputError, shown
from unilateral.formulas import grammar, hints
from unilateral.formulas.positive import pos, positive_power

Compiled = Callable[..., list[Array]]


def parse(text: object, variables: Sequence[str], where: str) -> sympy.Expr:
    """The sympy expression of a formula in the given variables; `where` names its place in errors.

    Raises InputError for anything outside the grammar, and for expressions that are not finite.
    """
    source = str(text).strip()
    try:
        with warnings.catch_warnings(action="ignore"):  # of Python's parser
            tree = grammar.tree(source, where)
        part: grammar.Part = grammar.Reader(source, variables, where).visit(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        kind = f"in {', '.join(variables)}" if variables else "of numbers, such as 3, 0.05 or 1/3"
        mended = hints.hint(source, error)
        raise InputError(f"{where}: '{shown(source)}' is not a formula {kind}{mended}") from None
    return part.value


def substituted(formula: sympy.Expr, values: Mapping[sympy.Symbol, sympy.Expr], where: str) -> sympy.Expr:
    """The formula with values, or other formulas, for some variables; InputError if it has none there."""
    try:
        found = formula.subs(values)
    except TypeError:  # pos of what is not real
        found = sympy.nan
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if not grammar.is_finite_and_real(found):
        raise InputError(f"{where}: it is not a finite real function")
    return found


def number(text: object, where: str) -> sympy.Expr:
    """An exact number such as 1/3, 0.05 or sqrt(2)."""
    return parse(text, (), where)


def real(text: object, where: str) -> float:
    """A number such as 1/64, in floating point."""
    return float(number(text, where))


def compile_numpy(expressions: Sequence[sympy.Expr], symbols: Sequence[sympy.Symbol]) -> Compiled:
    """A function of arrays, one per symbol, that returns the values of all the expressions as arrays."""
    raw = _compiled(tuple(expressions), tuple(symbols))

    def evaluate(*arrays: Array) -> list[Array]:
        shape = np.broadcast_shapes(*(np.shape(a) for a in arrays))
        return [np.broadcast_to(np.asarray(value, dtype=float), shape) for value in raw(*arrays)]

    return evaluate


@lru_cache(maxsize=1024)
def _compiled(expressions: tuple[sympy.Expr, ...], symbols: tuple[sympy.Symbol, ...]) -> Compiled:
    for_numpy = [
        e.xreplace({n: n.n(17) for n in e.atoms(sympy.Rational) if _is_large(n)}) for e in expressions
    ]
    return sympy.lambdify(symbols, for_numpy, [{"pos": positive_power}, "numpy"], cse=_shared)


def _shared(expressions: list[sympy.Expr]) -> tuple[list[Any], list[sympy.Expr]]:
    """What occurs more than once, by name; not what factors or terms have in common, which takes long."""
    found: tuple[list[Any], list[sympy.Expr]] = tree_cse(expressions, sympy.numbered_symbols())
    return found


def _is_large(n: sympy.Rational) -> bool:
    """Whether Python's whole numbers, as which it would be compiled, are none of numpy's, or no float."""
    return bool(abs(n) >= (2**63 if n.is_Integer else 2**1023))


@lru_cache(maxsize=1024)
def kinks(expression: sympy.Expr, symbol: sympy.Symbol) -> list[tuple[float, sympy.Expr]]:
    """The real zeros of the arguments of every pos(a, k) in `symbol`, each with its exponent k.

    Raises ValueError where an argument is not a polynomial with rational coefficients (up to degree 2 it may
    have any), or a non-integer power hides elsewhere.
    """
    if any(p.has(symbol) and not p.exp.is_integer for p in expression.atoms(sympy.Pow)):
        raise ValueError(hints.NO_ROOT)
    if expression.has(sympy.log):
        raise ValueError(f"log is not allowed here; known are {hints.offered(grammar.FUNCTIONS)}")
    found: set[tuple[float, sympy.Expr]] = set()
    powers = (part for part in sympy.preorder_traversal(expression) if isinstance(part, pos))
    for power in dict.fromkeys(powers):
        argument, exponent = power.args
        if not argument.is_polynomial(symbol):
            raise ValueError(f"the argument of {power} must be a polynomial")
        polynomial = sympy.Poly(argument, symbol)
        if polynomial.degree() > 2 and not all(c.is_Rational for c in polynomial.coeffs()):
            raise ValueError(f"the argument of {power} must have rational coefficients")
        found |= {(_as_float(root), exponent) for root in _real_roots(polynomial)}
    return sorted(found, key=lambda item: (item[0], float(item[1])))


def _as_float(root: sympy.Expr) -> float:
    """Infinite where it is too large, and so far away from the side that it does not count."""
    try:
        return float(root)
    except OverflowError:
        return math.inf


def _real_roots(polynomial: sympy.Poly) -> list[sympy.Expr]:
    """Without simplifying irrational coefficients, which one of degree 1 or 2 may have."""
    rational = all(c.is_Rational for c in polynomial.coeffs())
    if polynomial.degree() == 2 and rational:
        a, b, c = polynomial.all_coeffs()
        square = b**2 - 4 * a * c
        return [(sign * sympy.sqrt(square) - b) / (2 * a) for sign in (-1, 1)] if square >= 0 else []
    if polynomial.degree() == 2:
        found = np.roots([float(c) for c in polynomial.all_coeffs()])
        return [sympy.Float(root) for root in found[found.imag == 0].real]
    if polynomial.degree() > 2:
        return sympy.real_roots(polynomial)
    slope, constant = (polynomial.nth(power) for power in (1, 0))
    return [] if slope == 0 else [-constant / slope]
