"""The one grammar for formulas in data files: a whitelist, parsed to sympy and never evaluated as code.

A formula has numbers (decimals are taken exactly), the constant pi, the variables its place allows,
+ - * / **, and the functions below. `pos(a, k)` is the power a_+^k of the positive part, the only way
to write a kink or a singularity, so that both can be found again (see `kinks`).
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from typing import Any

import numpy as np
import sympy
from numpy.typing import NDArray
from sympy.core.function import ArgumentIndexError

from unilateral.errors import InputError

MAX_LENGTH = 2000
MAX_EXPONENT = 100
MAX_DENOMINATOR = 20
"""Of the powers of pos: singular points are graded by it, see `quadrature`."""
MAX_BITS = 1000
"""Of numerators and denominators, which then are finite in floating point."""

Array = NDArray[np.float64]
Compiled = Callable[..., list[Array]]


class pos(sympy.Function):
    """max(a, 0)**k; for k = 0 the indicator of a > 0."""

    nargs = 2

    @classmethod
    def eval(cls, a: sympy.Expr, k: sympy.Expr) -> sympy.Expr | None:
        if a.is_number:
            return a**k if _is_positive(a) else sympy.Integer(0)
        return None

    def fdiff(self, argindex: int = 1) -> sympy.Expr:
        a, k = self.args
        if argindex != 1 or k == 0:
            raise ArgumentIndexError(self, argindex)
        return k * pos(a, k - 1)


def _is_positive(number: sympy.Expr) -> bool:
    """Its value's sign; sympy's own test computes minimal polynomials, which may take for ever."""
    return bool(number > 0) if number.is_Rational else float(number) > 0


def positive_power(a: Array, k: float) -> Array:
    """a_+^k elementwise: 0 where a <= 0, whatever the sign of k."""
    a = np.asarray(a, dtype=float)
    positive = a > 0
    safe = np.where(positive, a, 1.0)
    if k == int(k) and 0 <= k <= 8:
        power = np.ones_like(safe)
        for _ in range(int(k)):
            power *= safe
    else:
        power = np.sqrt(safe) ** round(2 * k) if 2 * k == round(2 * k) else safe**k
    return np.where(positive, power, 0.0)


FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    "pos": (pos, 2),
    "sin": (sympy.sin, 1),
    "cos": (sympy.cos, 1),
    "exp": (sympy.exp, 1),
    "log": (sympy.log, 1),
    "sqrt": (sympy.sqrt, 1),
    "sinh": (sympy.sinh, 1),
    "cosh": (sympy.cosh, 1),
    "tanh": (sympy.tanh, 1),
}
OPERATORS: dict[type, Callable[[sympy.Expr, sympy.Expr], sympy.Expr]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}


def parse(text: object, variables: Sequence[str], where: str) -> sympy.Expr:
    """The sympy expression of a formula in the given variables; `where` names its place in errors.

    Raises InputError for anything outside the grammar, and for expressions that are not finite.
    """
    source = str(text)
    if len(source) > MAX_LENGTH:
        raise InputError(f"{where}: the formula has more than {MAX_LENGTH} characters")
    try:
        tree = ast.parse(source.strip(), mode="eval")
        value = _Reader(source.strip(), variables, where).visit(tree.body)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        kind = f"in {', '.join(variables)}" if variables else "of numbers"
        raise InputError(f"{where}: '{source}' is not a formula {kind}") from None
    return value


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
        e.xreplace({n: n.n(17) for n in e.atoms(sympy.Integer) if abs(n) >= 2**63}) for e in expressions
    ]
    return sympy.lambdify(symbols, for_numpy, [{"pos": positive_power}, "numpy"], cse=True)


def kinks(expression: sympy.Expr, symbol: sympy.Symbol) -> list[tuple[float, sympy.Expr]]:
    """The real zeros of the arguments of every pos(a, k) in `symbol`, each with its exponent k.

    Raises ValueError where an argument is not a polynomial with rational coefficients (up to degree 2 it may
    have any), or a non-integer power hides elsewhere.
    """
    if any(p.has(symbol) and not p.exp.is_integer for p in expression.atoms(sympy.Pow)):
        raise ValueError("write a fractional power as pos(a, k)")
    if expression.has(sympy.log):
        raise ValueError("log is not allowed here")
    found: set[tuple[float, sympy.Expr]] = set()
    for power in sorted(expression.atoms(pos), key=str):
        argument, exponent = power.args
        if not argument.is_polynomial(symbol):
            raise ValueError(f"the argument of {power} must be a polynomial")
        polynomial = sympy.Poly(argument, symbol)
        if polynomial.degree() > 2 and not all(c.is_Rational for c in polynomial.coeffs()):
            raise ValueError(f"the argument of {power} must have rational coefficients")
        found |= {(float(root), exponent) for root in _real_roots(polynomial)}
    return sorted(found, key=lambda item: (item[0], float(item[1])))


def _real_roots(polynomial: sympy.Poly) -> list[sympy.Expr]:
    """Without simplifying irrational coefficients, which one of degree 1 or 2 may have."""
    if polynomial.degree() > 1 and all(c.is_Rational for c in polynomial.coeffs()):
        return sympy.real_roots(polynomial)
    if polynomial.degree() == 2:
        found = np.roots([float(c) for c in polynomial.all_coeffs()])
        return [sympy.Float(root) for root in found[found.imag == 0].real]
    slope, constant = (polynomial.nth(power) for power in (1, 0))
    return [] if slope == 0 else [-constant / slope]


def _is_finite_and_real(value: sympy.Expr) -> bool:
    """Whether a number is; a function may still fail to be where it is evaluated."""
    if value.has(sympy.zoo, sympy.nan, sympy.oo, -sympy.oo, sympy.I):
        return False
    try:
        return not value.is_number or math.isfinite(float(value))
    except (OverflowError, TypeError):
        return False


class _Reader(ast.NodeVisitor):
    def __init__(self, source: str, variables: Iterable[str], where: str) -> None:
        self.source, self.where = source, where
        self.names = {name: sympy.Symbol(name, real=True) for name in variables} | {"pi": sympy.pi}

    def refuse(self, node: ast.AST, why: str) -> InputError:
        return InputError(f"{self.where}: '{self.text(node)}' {why}")

    def text(self, node: ast.AST) -> str:
        return ast.get_source_segment(self.source, node) or self.source

    def checked(self, node: ast.AST, value: sympy.Expr) -> sympy.Expr:
        """The value of a node; its size is bounded here, so that the next operation ends soon."""
        if any(max(n.p.bit_length(), n.q.bit_length()) > MAX_BITS for n in value.atoms(sympy.Rational)):
            raise self.refuse(node, "has a number that is too large")
        if not _is_finite_and_real(value):
            raise self.refuse(node, "is not a finite real number or function")
        if value.has(sympy.Abs):
            raise self.refuse(node, "hides a kink; write pos(a, 1) for the positive part of a")
        return value

    def generic_visit(self, node: ast.AST) -> sympy.Expr:
        raise self.refuse(node, "is not allowed in a formula")

    def visit_Constant(self, node: ast.Constant) -> sympy.Expr:
        try:
            value = Decimal(self.text(node))
        except InvalidOperation:
            raise self.refuse(node, "is not a decimal number") from None
        if abs(value.adjusted()) > MAX_BITS:
            raise self.refuse(node, "has a number that is too large")
        return self.checked(node, sympy.Rational(*value.as_integer_ratio()))

    def visit_Name(self, node: ast.Name) -> sympy.Expr:
        if node.id not in self.names:
            raise self.refuse(node, f"is unknown; known are {', '.join(self.names)}, {', '.join(FUNCTIONS)}")
        return self.names[node.id]

    def visit_UnaryOp(self, node: ast.UnaryOp) -> sympy.Expr:
        if not isinstance(node.op, ast.USub | ast.UAdd):
            raise self.refuse(node, "is not allowed in a formula")
        operand = self.visit(node.operand)
        return -operand if isinstance(node.op, ast.USub) else operand

    def visit_BinOp(self, node: ast.BinOp) -> sympy.Expr:
        if type(node.op) not in OPERATORS:
            raise self.refuse(node, "uses an operator that is not one of + - * / **")
        left, right = self.visit(node.left), self.visit(node.right)
        if isinstance(node.op, ast.Pow) and not (right.is_Rational and abs(right) <= MAX_EXPONENT):
            raise self.refuse(node, f"needs a rational exponent between -{MAX_EXPONENT} and {MAX_EXPONENT}")
        return self.checked(node, OPERATORS[type(node.op)](left, right))

    def visit_Call(self, node: ast.Call) -> sympy.Expr:
        if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS or node.keywords:
            raise self.refuse(node, f"is not a known function; known are {', '.join(FUNCTIONS)}")
        function, arity = FUNCTIONS[node.func.id]
        if len(node.args) != arity:
            raise self.refuse(node, f"takes {arity} argument{'s' if arity > 1 else ''}")
        arguments = [self.visit(argument) for argument in node.args]
        if function is pos and not _is_power(arguments[1]):
            limits = f"between 0 and {MAX_EXPONENT}, its denominator at most {MAX_DENOMINATOR}"
            raise self.refuse(node, f"needs a rational power {limits}")
        if function is pos and _degree(arguments[0]) > MAX_EXPONENT:
            raise self.refuse(node, f"needs an argument of a degree up to {MAX_EXPONENT}")
        return self.checked(node, function(*arguments))


def _degree(e: sympy.Expr) -> float:
    """At least that of a polynomial when it is multiplied out, which its zeros need."""
    if e.is_Pow and e.exp.is_Rational:
        return float(abs(e.exp)) * _degree(e.base)
    if e.is_Mul:
        return sum(map(_degree, e.args))
    return max(map(_degree, e.args), default=float(e.is_Symbol))


def _is_power(k: sympy.Expr) -> bool:
    return bool(k.is_Rational and 0 <= k <= MAX_EXPONENT and k.q <= MAX_DENOMINATOR)
