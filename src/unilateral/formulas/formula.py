"""The one grammar for formulas in data files: a whitelist, parsed to expressions, never evaluated as code.

A formula has numbers (decimals are taken exactly), the constant pi, the variables its place allows,
+ - * / **, and the functions of `grammar`. `pos(a, k)` is the power a_+^k of the positive part, the only way
to write a kink or a singularity, so that both can be found again (see `kinks`).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, reduce

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError, shown
from unilateral.formulas import grammar
from unilateral.formulas.exact_numbers import apply, nearest, rounded, sign
from unilateral.formulas.expression import (
    ZERO,
    Atom,
    Expression,
    atoms_in,
    expression,
    product,
    total,
)
from unilateral.formulas.expression import number as exact
from unilateral.formulas.formula_walk import Evaluation
from unilateral.formulas.interval import positive_power
from unilateral.formulas.roots import real_roots


def parse(
    text: object, variables: Sequence[str], where: str, least_power: int | None = grammar.JUMP
) -> Expression:
    """The formula in the given variables; `where` names its place in errors.

    Hints in messages use no power of pos below `least_power`, which the place allows; None is for no pos.

    Raises InputError for anything outside the grammar, and for expressions that are not finite.
    """
    source = str(text).strip()
    try:
        with warnings.catch_warnings(action="ignore"):  # of Python's parser
            tree = grammar.tree(source, where)
        part: grammar.FormulaPart = grammar.Reader(source, variables, where, least_power).visit(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        kind = f"in {', '.join(variables)}" if variables else "of numbers, such as 3, 0.05 or 1/3"
        mended = grammar.hint(source, variables, least_power)
        raise InputError(f"{where}: '{shown(source)}' is not a formula {kind}{mended}") from None
    return part.value


def substituted(formula: Expression, values: Mapping[str, Expression], where: str) -> Expression:
    """The formula with values, or other formulas, for some variables.

    Raises InputError if the result is not known to be a finite real function.
    """
    try:
        result = _Substituted((formula,), {Atom(name): value for name, value in values.items()}).of(formula)
        finite = grammar.is_finite_and_real(result)
    except ArithmeticError:
        finite = False
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if not finite:
        raise InputError(f"{where}: it is not a finite real function")
    return result


class Formulas(Evaluation[Expression]):
    """Formulas with other formulas for the `known` variables."""

    def number(self, value: Fraction) -> Expression:
        return exact(value)

    def power(self, base: Expression, k: Fraction) -> Expression:
        return base**k

    def function(self, of: Atom) -> Expression:
        return apply(of.name, *map(self.of, of.args)) if of.args else expression(of)


class _Substituted(Formulas):
    def constant(self, e: Expression) -> Expression:
        return e


class _Expanded(Formulas):
    """Formulas that are multiplied out, numbers too."""

    def product(self, a: Expression, b: Expression) -> Expression:
        return total(
            term for of, c in a.terms for also, d in b.terms for term in product(c * d, [*of, *also]).terms
        )

    def power(self, base: Expression, k: Fraction) -> Expression:
        return reduce(self.product, [base] * int(k)) if k > 0 and k.denominator == 1 else base**k


def number(text: object, where: str) -> Expression:
    """An exact number such as 1/3, 0.05 or sqrt(2)."""
    return parse(text, (), where, least_power=None)


def fraction(text: object, where: str) -> Fraction:
    """An exact fraction such as 1/3 or 0.05. Raises InputError for a number that is none, such as sqrt(2)."""
    value = number(text, where).rational
    if value is None:
        raise InputError(f"{where}: {shown(text)} must be a fraction")
    return value


def real(text: object, where: str) -> float:
    """A number such as 1/64, in floating point."""
    return rounded(number(text, where))


@dataclass(frozen=True, eq=False)
class Compiled:
    """Formulas as a function of arrays, one per variable, which returns the values of all of them."""

    formulas: tuple[Expression, ...]
    variables: tuple[str, ...]

    def __call__(self, *arrays: Array) -> list[Array]:
        values = (np.asarray(a, dtype=float) for a in arrays)
        known = {Atom(name): a for name, a in zip(self.variables, values, strict=True)}
        shape = np.broadcast_shapes(*(a.shape for a in known.values()))
        read = _Arrays(self.formulas, known)
        return [np.broadcast_to(np.asarray(read.of(e), dtype=float), shape) for e in self.formulas]


def compile_numpy(formulas: Sequence[Expression], names: Sequence[str]) -> Compiled:
    """A function of arrays, one per variable, that returns the values of all the formulas as arrays."""
    return Compiled(tuple(formulas), tuple(names))


class _Arrays(Evaluation[Array]):
    def number(self, value: Fraction) -> Array:
        return np.array(float(value))

    def constant(self, e: Expression) -> Array:
        return np.array(nearest(e))

    def power(self, base: Array, k: Fraction) -> Array:
        return np.asarray(base ** (int(k) if k.denominator == 1 else float(k)))

    def function(self, of: Atom) -> Array:
        a = self.of(of.args[0])
        return positive_power(a, nearest(of.args[1])) if of.name == "pos" else getattr(np, of.name)(a)


@lru_cache(maxsize=1024)
def kinks(formula: Expression, name: str) -> list[tuple[float, Fraction]]:
    """The real zeros of the arguments of every pos(a, k) in the one variable, each with its exponent k.

    Raises ValueError where an argument is not a polynomial with rational coefficients (up to degree 2 it may
    have any).
    """
    zeros: set[tuple[float, Fraction]] = set()
    for power in atoms_in(formula, "pos"):
        argument, exponent = power.args
        polynomial = coefficients(argument, (name,))
        if polynomial is None:
            raise ValueError(f"the argument of {power} must be a polynomial")
        degree = max((i for (i,) in polynomial), default=0)
        of = [polynomial.get((i,), ZERO) for i in range(degree, -1, -1)]
        if degree > 2 and any(c.rational is None for c in of):
            raise ValueError(f"the argument of {power} must have rational coefficients")
        zeros |= {(root, exponent.rational or Fraction(0)) for root in _real_roots(of)}
    return sorted(zeros)


def coefficients(formula: Expression, names: Sequence[str]) -> dict[tuple[int, ...], Expression] | None:
    """The coefficients of a polynomial in these variables, by their exponents; None if it is no polynomial.

    Raises ValueError where one cannot be distinguished from 0.
    """
    sums: dict[tuple[int, ...], Expression] = {}
    for of, c in _Expanded((formula,), {}).of(formula).terms:
        exponents = {
            base.name: k for base, k in of if isinstance(base, Atom) and base.variables and not base.args
        }
        rest = [power for power in of if not power[0].variables]
        if len(exponents) + len(rest) < len(of) or any(
            k < 0 or k.denominator > 1 for k in exponents.values()
        ):
            return None
        key = tuple(int(exponents.get(name, 0)) for name in names)
        sums[key] = sums.get(key, ZERO) + product(c, rest)
    return {key: c for key, c in sums.items() if sign(c)}


def _real_roots(of: Sequence[Expression]) -> list[float]:
    """The real roots of a polynomial, its coefficient of the highest power first.

    Irrational coefficients are rounded for degree 2. A root that is too large is infinite: it is so far away
    from the side that it does not count.
    """
    if len(of) == 1:
        return []
    if len(of) == 2:
        return [nearest(-of[1] / of[0])]
    if len(of) > 3:
        return real_roots([c.rational or Fraction(0) for c in of])
    a, b, c = of
    if any(each.rational is None for each in of):
        roots = np.roots([nearest(each) for each in of])
        return [float(root) for root in roots[roots.imag == 0].real]
    square = b**2 - (a * c).scaled(4)
    if sign(square) < 0:
        return []
    return [nearest(((square ** Fraction(1, 2)).scaled(i) - b) / a.scaled(2)) for i in (-1, 1)]
