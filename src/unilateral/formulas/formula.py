"""The one grammar for formulas in data files: a whitelist, parsed to expressions, never evaluated as code.

A formula has numbers (decimals are taken exactly), the constant pi, the variables its place allows,
+ - * / **, and the functions of `grammar`. `pos(a, k)` is the power a_+^k of the positive part, the only way
to write a kink or a singularity, so that both can be found again (see `find_kinks`).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, reduce

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError, quote_input
from unilateral.formulas import grammar
from unilateral.formulas.exact_numbers import apply_function, as_float, as_float_or_inf, sign
from unilateral.formulas.expression import (
    ZERO,
    Expression,
    Primitive,
    find_functions,
    multiply_powers,
    primitive_expression,
    rational_expression,
    sum_terms,
)
from unilateral.formulas.formula_walk import Evaluation
from unilateral.formulas.interval import positive_power
from unilateral.formulas.roots import real_roots


def parse_formula(
    text: object, variables: Sequence[str], where: str, least_power: int | None = grammar.JUMP_POWER
) -> Expression:
    """The formula in the given variables; `where` names its place in errors.

    Hints in messages use no power of pos below `least_power`, which the place allows; None is for no pos.
    Raises InputError for anything outside the grammar, and for expressions that are not finite.
    """
    source = str(text).strip()
    try:
        with warnings.catch_warnings(action="ignore"):  # of Python's parser
            tree = grammar.parse_syntax_tree(source, where)
        reader = grammar.FormulaReader(source, variables, where, least_power)
        parsed: grammar.ParsedFormula = reader.visit(tree)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        kind = f"in {', '.join(variables)}" if variables else "of numbers, such as 3, 0.05 or 1/3"
        hint = grammar.syntax_hint(source, variables, least_power)
        raise InputError(f"{where}: '{quote_input(source)}' is not a formula {kind}{hint}") from None
    return parsed.value


def substitute(formula: Expression, values: Mapping[str, Expression], where: str) -> Expression:
    """The formula with values, or other formulas, for some variables.

    Raises InputError if the result is not known to be a finite real function.
    """
    try:
        known_values = {Primitive(name): value for name, value in values.items()}
        result = _Substitution((formula,), known_values).evaluate(formula)
        finite = grammar.is_finite_and_real(result)
    except ArithmeticError:
        finite = False
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if not finite:
        raise InputError(f"{where}: it is not a finite real function")
    return result


class FormulaEvaluation(Evaluation[Expression]):
    """Formulas with other formulas, the `values`, for some variables."""

    def number(self, value: Fraction) -> Expression:
        """The expression of a rational number."""
        return rational_expression(value)

    def power(self, base: Expression, k: Fraction) -> Expression:
        """The expression of a power."""
        return base**k

    def function(self, primitive: Primitive) -> Expression:
        """The function of the evaluated arguments; a variable without a value as it is."""
        if not primitive.args:
            return primitive_expression(primitive)
        return apply_function(primitive.name, *map(self.evaluate, primitive.args))


class _Substitution(FormulaEvaluation):
    def constant(self, e: Expression) -> Expression:
        """The expression without variables as it is."""
        return e


class _Expansion(FormulaEvaluation):
    """Formulas with all products and whole powers of sums multiplied out, those of numbers, too."""

    def product(self, a: Expression, b: Expression) -> Expression:
        """The product of two sums, term by term."""
        return sum_terms(
            term
            for a_powers, c in a.terms
            for b_powers, d in b.terms
            for term in multiply_powers(c * d, [*a_powers, *b_powers]).terms
        )

    def power(self, base: Expression, k: Fraction) -> Expression:
        """The power of a sum, multiplied out if its exponent is a whole number above 0."""
        return reduce(self.product, [base] * int(k)) if k > 0 and k.denominator == 1 else base**k


def parse_number(text: object, where: str) -> Expression:
    """An exact number such as 1/3, 0.05 or sqrt(2)."""
    return parse_formula(text, (), where, least_power=None)


def parse_fraction(text: object, where: str) -> Fraction:
    """An exact fraction such as 1/3 or 0.05. Raises InputError for a number that is none, such as sqrt(2)."""
    value = parse_number(text, where).rational
    if value is None:
        raise InputError(f"{where}: {quote_input(text)} must be a fraction")
    return value


def parse_real(text: object, where: str) -> float:
    """A number such as 1/64, in floating point."""
    return as_float(parse_number(text, where))


@dataclass(frozen=True, eq=False)
class CompiledFormulas:
    """Formulas as a function of arrays, one per variable, which returns the values of all of them."""

    formulas: tuple[Expression, ...]
    variables: tuple[str, ...]

    def __call__(self, *arrays: Array) -> list[Array]:
        """Values of each formula at the arrays, one per variable, which are broadcast to one shape."""
        values = (np.asarray(a, dtype=float) for a in arrays)
        arguments = {Primitive(name): a for name, a in zip(self.variables, values, strict=True)}
        shape = np.broadcast_shapes(*(a.shape for a in arguments.values()))
        evaluation = _ArrayEvaluation(self.formulas, arguments)
        results = [np.asarray(evaluation.evaluate(e), dtype=float) for e in self.formulas]
        return [np.broadcast_to(result, shape) for result in results]


def compile_numpy(formulas: Sequence[Expression], variables: Sequence[str]) -> CompiledFormulas:
    """A function of arrays, one per variable, that returns the values of all the formulas as arrays."""
    return CompiledFormulas(tuple(formulas), tuple(variables))


class _ArrayEvaluation(Evaluation[Array]):
    def number(self, value: Fraction) -> Array:
        """The rational number in floating point."""
        return np.array(float(value))

    def constant(self, e: Expression) -> Array:
        """The expression without variables in floating point, infinite if it is too large."""
        return np.array(as_float_or_inf(e))

    def power(self, base: Array, k: Fraction) -> Array:
        """The power of an array."""
        return np.asarray(base ** (int(k) if k.denominator == 1 else float(k)))

    def function(self, primitive: Primitive) -> Array:
        """The values of a function of an array."""
        a = self.evaluate(primitive.args[0])
        if primitive.name == "pos":
            return positive_power(a, as_float_or_inf(primitive.args[1]))
        return getattr(np, primitive.name)(a)


@lru_cache(maxsize=1024)
def find_kinks(formula: Expression, variable: str) -> list[tuple[float, Fraction]]:
    """The real zeros of the arguments of every pos(a, k) in the one variable, each with its exponent k.

    Raises ValueError where an argument is not a polynomial with rational coefficients (up to degree 2 it may
    have any).
    """
    zeros: set[tuple[float, Fraction]] = set()
    for power in find_functions(formula, "pos"):
        argument, exponent = power.args
        polynomial = polynomial_coefficients(argument, (variable,))
        if polynomial is None:
            raise ValueError(f"the argument of {power} must be a polynomial")
        # a_n t^n + .. + a_0, the coefficient of the highest power first
        degree = max((i for (i,) in polynomial), default=0)
        coefficients = [polynomial.get((i,), ZERO) for i in range(degree, -1, -1)]
        if degree > 2 and any(c.rational is None for c in coefficients):
            raise ValueError(f"the argument of {power} must have rational coefficients")
        zeros |= {(root, exponent.rational or Fraction(0)) for root in _polynomial_roots(coefficients)}
    return sorted(zeros)


def polynomial_coefficients(
    formula: Expression, variables: Sequence[str]
) -> dict[tuple[int, ...], Expression] | None:
    """The coefficients of a polynomial in these variables, by their exponents; None if it is no polynomial.

    Raises ValueError where one cannot be distinguished from 0.
    """
    # The same monomial may have several terms, such as pi x and 2 x, whose coefficients are added
    sums: dict[tuple[int, ...], Expression] = {}
    for powers, c in _Expansion((formula,), {}).evaluate(formula).terms:
        exponents = {b.name: k for b, k in powers if isinstance(b, Primitive) and b.variables and not b.args}
        # A term is a monomial times constants, and no monomial if anything else depends on a variable
        constants = [power for power in powers if not power[0].variables]
        if len(exponents) + len(constants) < len(powers) or any(
            k < 0 or k.denominator > 1 for k in exponents.values()
        ):
            return None
        key = tuple(int(exponents.get(name, 0)) for name in variables)
        sums[key] = sums.get(key, ZERO) + multiply_powers(c, constants)
    return {key: c for key, c in sums.items() if sign(c)}


def _polynomial_roots(coefficients: Sequence[Expression]) -> list[float]:
    """The real roots of a polynomial, its coefficient of the highest power first.

    Irrational coefficients are rounded for degree 2, and `find_kinks` refuses them for any higher one. A root
    that is too large is infinite: it is so far away from the side that it does not count.
    """
    if len(coefficients) == 1:
        return []
    if len(coefficients) == 2:
        return [as_float_or_inf(-coefficients[1] / coefficients[0])]
    if len(coefficients) > 3:
        return real_roots([c.rational or Fraction(0) for c in coefficients])
    # a t^2 + b t + c = 0 at t = (-b -+ (b^2 - 4 a c)^(1/2)) / (2 a), the discriminant's sign exactly
    a, b, c = coefficients
    if any(coefficient.rational is None for coefficient in coefficients):
        roots = np.roots([as_float_or_inf(coefficient) for coefficient in coefficients])
        return [float(root) for root in roots[roots.imag == 0].real]
    discriminant = b**2 - (a * c).scale(4)
    if sign(discriminant) < 0:
        return []
    return [as_float_or_inf(((discriminant ** Fraction(1, 2)).scale(i) - b) / a.scale(2)) for i in (-1, 1)]
