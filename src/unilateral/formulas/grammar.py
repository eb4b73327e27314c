"""The grammar of formulas: a whitelist, limits that are looked at before any work, and hints in messages."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from itertools import accumulate
from typing import NamedTuple

from unilateral.errors import InputError, shown
from unilateral.formulas.exact_numbers import apply, rounded, sign
from unilateral.formulas.expression import ZERO, Expression, hides_kink, number, variable

MAX_LENGTH = 2000
MAX_NESTING = 30
"""Parentheses may be nested this deep."""
MAX_OPERATIONS = 500
"""A formula may have this many signs, functions and operators."""
MAX_FUNCTIONS = 6
"""Functions may be nested this deep."""
MAX_DEGREE = 100
"""The largest degree of a product or a power if it were multiplied out, and the largest exponent."""
MAX_KINK_DEGREE = 20
"""The largest degree of the argument of pos, whose zeros are computed exactly."""
MAX_DENOMINATOR = 20
"""The largest denominator of the powers of pos. Singular points are graded by it, see `quadrature`."""
MAX_BITS = 1000
"""Numerators and denominators may have this many bits; then they are finite in floating point."""

FUNCTIONS = {"pos": 2} | dict.fromkeys(("sin", "cos", "exp", "log", "sqrt", "sinh", "cosh", "tanh"), 1)
"""The functions of formulas, each with the number of its arguments."""
OFFERED = ", ".join(name for name in FUNCTIONS if name not in ("log", "sqrt"))
"""The functions that messages offer: formulas may have those two of numbers, not of x, y or t."""
NO_POWER = -1
KINK = 1
JUMP = 0
"""The least power of pos that a hint needs: none, that of a kink, that of a jump."""
INSTEAD = {
    "abs": (KINK, "pos(a, 1) + pos(-a, 1) for abs(a)"),
    "max": (KINK, "b + pos(a - b, 1) for max(a, b)"),
    "min": (KINK, "a - pos(a - b, 1) for min(a, b)"),
    "sign": (JUMP, "2*pos(a, 0) - 1 for sign(a)"),
    "where": (JUMP, "b + (a - b)*pos(c, 0) for where(c > 0, a, b)"),
    "ln": (NO_POWER, "log(a) for ln(a), where a is a number"),
    "log10": (NO_POWER, "log(a)/log(10) for log10(a), where a is a number"),
    "tan": (NO_POWER, "sin(a)/cos(a) for tan(a)"),
    "pow": (NO_POWER, "a**k for pow(a, k)"),
    "cbrt": (NO_POWER, "a**(1/3) for cbrt(a)"),
} | dict.fromkeys(
    ("heaviside", "Heaviside", "step"), (JUMP, "pos(a, 0), which is 1 where a > 0 and 0 elsewhere")
)
"""What to write in place of functions that people try, and the least power of pos in it."""
NO_LOG = "log is allowed for numbers only, such as log(2)"
NO_ROOT = "write a fractional power as pos(a, k), such as pos(a, 1/2) for sqrt(a)"
NO_CONDITION = "there are no conditions in formulas"
NO_UNITS = "; units are not read; write numbers alone, in one system of units such as N and m"
UNITS = (
    *("m", "mm", "cm", "km", "s", "kg", "g", "t", "N", "kN", "MN", "Nm", "J", "Pa", "kPa", "MPa", "GPa"),
    *("bar", "inch", "ft", "lb", "lbf", "psi", "rad", "deg"),
)
"""Names of units that people try. One beside a number, as in 600mm, need not be listed."""
LETTERS = {
    **{"π": "pi", "²": "**2", "³": "**3", "√": "sqrt"},
    **{"·": "*", "×": "*", "÷": "/", "−": "-", "–": "-"},
}
"""What to write for letters that formulas do not have."""
MODULES = ("np", "numpy", "math", "sympy", "sp", "ufl")
"""What people write, with a point, before names that need nothing there."""
CONDITION = re.compile(r"[<>]|\bif\b")
COMMA = re.compile(r"(?<![\w.])(\d+),(\d+)")
"""A number with a decimal comma."""
THOUSANDS = re.compile(r"(?<![\w.,])[1-9]\d{0,2}(?:,\d{3})+(?![\d,])(\.\d*)?")
"""A number whose thousands are set off by commas; it has decimals or not."""
PERCENT = re.compile(r"(?<![\w.])(\d+(?:\.\d*)?)\s*%")
UNFINISHED = re.compile(r"(?<![\w.])\d+(?:\.\d*)?[eE](?![\w.]|[-+]\w)")
"""A power of ten without its exponent, such as 1e."""
LEADING_ZEROS = re.compile(r"(?<![\w.])0+([1-9]\d*)(?![\w.])")
FACTOR = re.compile(r"(?<![\w.])(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(?![eE][-+\d])([a-zA-Z]\w*|\()")
"""A number and what it multiplies without a sign, such as 2x."""
HALF = Fraction(1, 2)
OPERATORS: dict[type, Callable[[Expression, Expression], Expression]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a ** (b.rational or 0),
}
COUNTED = (ast.BinOp, ast.UnaryOp, ast.Call)


class FormulaPart(NamedTuple):
    """The value of a part of a formula, an upper bound on its degree, and how deep functions nest in it."""

    value: Expression
    degree: float = 0.0
    functions: int = 0


def tree(source: str, where: str) -> ast.expr:
    """The syntax tree of a formula.

    Raises InputError beyond a limit, and SyntaxError, ValueError, RecursionError or MemoryError, as Python's
    parser does, where there is no tree.
    """
    nesting = max(accumulate((c == "(") - (c == ")") for c in source), default=0)
    _check(len(source), MAX_LENGTH, f"{where}: the formula has more than {{}} characters")
    _check(nesting, MAX_NESTING, f"{where}: the formula has more than {{}} nested parentheses")
    body = ast.parse(source, mode="eval").body
    operations = sum(isinstance(node, COUNTED) for node in ast.walk(body))
    _check(operations, MAX_OPERATIONS, f"{where}: the formula has more than {{}} operations")
    return body


def _check(size: int, limit: int, message: str) -> None:
    if size > limit:
        raise InputError(message.format(limit))


class Reader(ast.NodeVisitor):
    """Makes a `FormulaPart` of a syntax tree; raises InputError for what the grammar does not have."""

    def __init__(
        self, source: str, variables: Iterable[str], where: str, least_power: int | None = JUMP
    ) -> None:
        """`least_power` is the least power of pos that the place allows, None for a place without pos."""
        self.source = source
        self.where = where
        self.least_power = least_power
        self.names = {name: FormulaPart(variable(name), 1.0) for name in variables}
        self.names["pi"] = FormulaPart(variable("pi"))

    def refuse(self, node: ast.AST, why: str) -> InputError:
        return InputError(f"{self.where}: '{shown(self.text(node))}' {why}")

    def text(self, node: ast.AST) -> str:
        return ast.get_source_segment(self.source, node) or self.source

    def checked(
        self, node: ast.AST, value: Callable[[], Expression], degree: float = 0.0, functions: int = 0
    ) -> FormulaPart:
        """The value of a node; its size is bounded here, so that the next operation ends soon."""
        try:
            result = value()
            if any(max(map(int.bit_length, n.as_integer_ratio())) > MAX_BITS for n in _numbers(result)):
                raise self.refuse(node, "has a number that is too large or too small")
            finite = is_finite_and_real(result)
            if not result.variables and finite and sign(result) == 0:
                result = ZERO
        except ArithmeticError:
            finite = False
        except ValueError:
            raise self.refuse(node, "cannot be distinguished from 0; write it as a single number") from None
        if not finite:
            raise self.refuse(node, "is not a finite real number or function")
        return FormulaPart(result, degree, functions if result.variables else 0)

    def generic_visit(self, node: ast.AST) -> FormulaPart:
        raise self.refuse(node, "is not allowed in a formula")

    def visit_Compare(self, node: ast.AST) -> FormulaPart:
        raise self.refuse(node, f"is not allowed in a formula{condition(self.names, self.least_power)}")

    visit_IfExp = visit_Compare

    def visit_Attribute(self, node: ast.Attribute) -> FormulaPart:
        raise self.refuse(node, f"is not allowed in a formula{self.bare(node)}")

    def visit_Subscript(self, node: ast.Subscript) -> FormulaPart:
        point = shown(self.text(node.value))
        hint = f"; write x for {point}[0] and y for {point}[1]" if {"x", "y"} <= {*self.names} else ""
        hint = NO_UNITS if isinstance(node.value, ast.Constant) else hint
        raise self.refuse(node, f"is not allowed in a formula{hint}")

    def bare(self, node: ast.expr) -> str:
        """The hint to leave out the module before a name such as np.sin."""
        if not isinstance(node, ast.Attribute) or self.text(node.value) not in MODULES:
            return ""
        return write(node.attr, self.text(node)) if node.attr in (*self.names, *FUNCTIONS) else ""

    def visit_Tuple(self, node: ast.Tuple) -> FormulaPart:
        raise self.refuse(node, f"is not allowed in a formula{comma(self.text(node))}")

    def visit_Constant(self, node: ast.Constant) -> FormulaPart:
        try:
            value = Decimal(self.text(node))
        except InvalidOperation:
            raise self.refuse(node, "is not a decimal number") from None
        if abs(value.adjusted()) > MAX_BITS:
            raise self.refuse(node, "has a number that is too large or too small")
        return self.checked(node, lambda: number(Fraction(value)))

    def visit_Name(self, node: ast.Name) -> FormulaPart:
        if node.id in FUNCTIONS:
            argument = "(a, k)" if FUNCTIONS[node.id] > 1 else "(a)"
            raise self.refuse(node, f"is a function; write its argument after it, as in {node.id}{argument}")
        if node.id not in self.names:
            instead = named(node.id, self.names)
            known = f"; known are {', '.join(self.names)}, {OFFERED}"
            raise self.refuse(node, f"is unknown{instead or known}")
        return self.names[node.id]

    def visit_UnaryOp(self, node: ast.UnaryOp) -> FormulaPart:
        if not isinstance(node.op, ast.USub | ast.UAdd):
            raise self.refuse(node, "is not allowed in a formula")
        operand = self.visit(node.operand)
        return operand._replace(value=-operand.value) if isinstance(node.op, ast.USub) else operand

    def visit_BinOp(self, node: ast.BinOp) -> FormulaPart:
        """Follows a chain such as a + b + c by a loop; it may be longer than Python's recursion is deep."""
        chain = [node]
        while isinstance(chain[-1].left, ast.BinOp):
            chain.append(chain[-1].left)
        part: FormulaPart = self.visit(chain[-1].left)
        for each in reversed(chain):
            part = self.combined(each, part, self.visit(each.right))
        return part

    def combined(self, node: ast.BinOp, left: FormulaPart, right: FormulaPart) -> FormulaPart:
        """The part of a formula that an operator makes of two."""
        if type(node.op) not in OPERATORS:
            text = self.text(node)
            power = write(text.replace("^", "**"), text) if "^" in text else ""
            raise self.refuse(node, f"uses an operator other than + - * / **{power}")
        degree = max(left.degree, right.degree)
        functions = max(left.functions, right.functions)
        if isinstance(node.op, ast.Pow):
            k = right.value.rational
            if k is None or abs(k) > MAX_DEGREE:
                raise self.refuse(node, f"needs a rational exponent between -{MAX_DEGREE} and {MAX_DEGREE}")
            self.check_kink(node, left.value, k)
            degree = left.degree * abs(float(k))
            functions = functions + (k.denominator > 1)
        elif isinstance(node.op, ast.Mult | ast.Div):
            degree = left.degree + right.degree
        self.check_limits(node, degree, functions)
        operator = OPERATORS[type(node.op)]
        return self.checked(node, lambda: operator(left.value, right.value), degree, functions)

    def visit_Call(self, node: ast.Call) -> FormulaPart:
        if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS or node.keywords:
            raise self.not_called(node, self.text(node.func))
        function = node.func.id
        arity = FUNCTIONS[node.func.id]
        if len(node.args) != arity:
            mended = comma(self.text(node)) if len(node.args) > arity else ""
            raise self.refuse(node, f"takes {arity} argument{'s' if arity > 1 else ''}{mended}")
        arguments = [self.visit(argument) for argument in node.args]
        values = [part.value for part in arguments]
        degree = arguments[0].degree
        if function == "pos":
            degree *= self.checked_power(node, *arguments)
        functions = 1 + arguments[0].functions
        self.check_limits(node, degree, functions)
        if function == "sqrt":
            self.check_kink(node, values[0], HALF)
            return self.checked(node, lambda: values[0] ** HALF, degree, functions)
        return self.checked(node, lambda: apply(function, *values), degree, functions)

    def not_called(self, node: ast.Call, name: str) -> InputError:
        """The refusal of a call of what is no function; it may have been meant as a factor."""
        if isinstance(node.func, ast.Constant) or name in self.names:
            factors = shown(f"{name}*{self.text(node).removeprefix(name).strip()}")
            return self.refuse(node, f"is not a product; write {factors}")
        least_power, instead = INSTEAD.get(name, (NO_POWER, ""))
        lower = name.lower()
        if least_power != NO_POWER and (self.least_power is None or least_power < self.least_power):
            return self.refuse(node, f"is not a known function{positive_part(self.names, self.least_power)}")
        if not instead and lower in FUNCTIONS and not node.keywords:
            instead = f"{lower} for {name}"
        hint = f"; write {instead}" if instead else self.bare(node.func)
        return self.refuse(node, f"is not a known function{hint or f'; known are {OFFERED}'}")

    def check_limits(self, node: ast.AST, degree: float, functions: int) -> None:
        if degree > MAX_DEGREE:
            raise self.refuse(
                node, f"has the degree {degree:g} when multiplied out; at most {MAX_DEGREE} is allowed"
            )
        if functions > MAX_FUNCTIONS:
            raise self.refuse(node, f"has more than {MAX_FUNCTIONS} nested functions")

    def check_kink(self, node: ast.AST, base: Expression, k: Fraction) -> None:
        if hides_kink(base, k):
            raise self.refuse(node, "has a kink; write pos(a, 1) + pos(-a, 1) for abs(a)")

    def checked_power(self, node: ast.AST, argument: FormulaPart, power: FormulaPart) -> float:
        """The power k of pos(a, k), which has to be a number within the limits."""
        k = power.value.rational
        if k is None or not (0 <= k <= MAX_DEGREE and k.denominator <= MAX_DENOMINATOR):
            limits = f"between 0 and {MAX_DEGREE}, with a denominator of at most {MAX_DENOMINATOR}"
            raise self.refuse(node, f"needs a rational power {limits}")
        if argument.degree > MAX_KINK_DEGREE:
            raise self.refuse(node, f"needs an argument of degree at most {MAX_KINK_DEGREE}")
        return float(k)


def is_finite_and_real(value: Expression) -> bool:
    """Whether a number is finite and real; a function counts as such, and may fail where it is evaluated.

    Raises ValueError for a number that cannot be distinguished from 0.
    """
    try:
        return bool(value.variables) or math.isfinite(rounded(value))
    except ArithmeticError:
        return False


def _numbers(e: Expression) -> Iterable[Fraction]:
    """The coefficients and exponents of its terms."""
    return [*(c for _, c in e.terms), *(k for of, _ in e.terms for _, k in of)]


def condition(names: Iterable[str], least_power: int | None) -> str:
    """What to write in place of a condition, after a semicolon; see `Reader` for `least_power`."""
    return f"; {NO_CONDITION}{positive_part(names, least_power)}"


def positive_part(names: Iterable[str], least_power: int | None) -> str:
    """What pos is with the least power of a place, after a semicolon; nothing for a place without pos."""
    variable = next((name for name in names if name != "pi"), None)
    if least_power is None or variable is None:
        return ""
    if least_power == JUMP:
        example = f"such as pos({variable} - 1/2, 0) for {variable} > 1/2"
        return f"; pos(a, 0) is 1 where a > 0 and 0 elsewhere, {example}"
    power = "a" if least_power == KINK else f"a**{least_power}"
    return f"; pos(a, {least_power}) is {power} where a > 0 and 0 elsewhere; jumps are not allowed here"


def named(name: str, known: Iterable[str]) -> str:
    """What to write for an unknown name, after a semicolon; nothing where that cannot be guessed."""
    if name in UNITS:
        return NO_UNITS
    if name in ("e", "E"):
        return write("exp(1)", name)
    instead = LETTERS.get(name, name.lower())
    return write(instead, name) if instead in (*known, *FUNCTIONS) and instead != name else ""


def write(instead: str, given: str) -> str:
    """The hint to write something else, after a semicolon; both texts are cut if they are long."""
    return f"; write {shown(instead)} for {shown(given)}"


def hint(source: str, names: Sequence[str], least_power: int | None) -> str:
    """How to mend what Python's parser refused, after a semicolon; nothing where that cannot be guessed."""
    if CONDITION.search(source):
        return condition(names, least_power)
    if letter := next((letter for letter in source if letter in LETTERS), ""):
        return write(LETTERS[letter], letter)
    if part := PERCENT.search(source):
        return write(f"{part[1]}/100", part[0])
    if UNFINISHED.search(source):
        return "; write the exponent of a power of ten, such as 1e-3, and exp(1) for the number e"
    if product := FACTOR.search(source):
        if product[2] in (*names, "pi", *FUNCTIONS, "("):
            return write(f"{product[1]}*{product[2]}", product[0])
        if {*product[2]} <= {*names}:
            return write("*".join((product[1], *product[2])), product[0])
        return "" if product[2] in ("x", "y", "z") else NO_UNITS
    if zeros := LEADING_ZEROS.search(source):
        return comma(source) or write(zeros[1], zeros[0])
    return comma(source)


def comma(source: str) -> str:
    """What to write in place of a comma in a number, if there may be one: of decimals or of thousands."""
    if thousands := THOUSANDS.search(source):
        whole = thousands[0].replace(",", "")
        decimals = thousands[0].replace(",", ".")
        clear = thousands[1] or thousands[0].count(",") > 1
        return write(whole if clear else f"{whole} or {decimals}", thousands[0])
    pair = COMMA.search(source)
    return write(f"{pair[1]}.{pair[2]}", pair[0]) if pair else ""
