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

from unilateral.errors import InputError, quote_input
from unilateral.formulas.exact_numbers import apply_function, as_float, sign
from unilateral.formulas.expression import ZERO, Expression, hides_kink, rational_expression, variable

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

FUNCTION_ARITIES = {"pos": 2} | dict.fromkeys(("sin", "cos", "exp", "log", "sqrt", "sinh", "cosh", "tanh"), 1)
"""The functions of formulas, each with the number of its arguments."""
OFFERED_FUNCTIONS = ", ".join(name for name in FUNCTION_ARITIES if name not in ("log", "sqrt"))
"""The functions that messages offer: formulas may have those two of numbers, not of x, y or t."""
NO_POWER = -1
KINK_POWER = 1
JUMP_POWER = 0
"""The least power of pos that a hint needs: none, that of a kink, that of a jump."""
FUNCTION_SUBSTITUTES = {
    "abs": (KINK_POWER, "pos(a, 1) + pos(-a, 1) for abs(a)"),
    "max": (KINK_POWER, "b + pos(a - b, 1) for max(a, b)"),
    "min": (KINK_POWER, "a - pos(a - b, 1) for min(a, b)"),
    "sign": (JUMP_POWER, "2*pos(a, 0) - 1 for sign(a)"),
    "where": (JUMP_POWER, "b + (a - b)*pos(c, 0) for where(c > 0, a, b)"),
    "ln": (NO_POWER, "log(a) for ln(a), where a is a number"),
    "log10": (NO_POWER, "log(a)/log(10) for log10(a), where a is a number"),
    "tan": (NO_POWER, "sin(a)/cos(a) for tan(a)"),
    "pow": (NO_POWER, "a**k for pow(a, k)"),
    "cbrt": (NO_POWER, "a**(1/3) for cbrt(a)"),
} | dict.fromkeys(
    ("heaviside", "Heaviside", "step"), (JUMP_POWER, "pos(a, 0), which is 1 where a > 0 and 0 elsewhere")
)
"""What to write in place of functions that people try, and the least power of pos in it."""
NO_LOG = "log is allowed for numbers only, such as log(2)"
NO_ROOT = "write a fractional power as pos(a, k), such as pos(a, 1/2) for sqrt(a)"
NO_CONDITION = "there are no conditions in formulas"
NO_UNITS = "; units are not read; write numbers alone, in one system of units such as N and m"
UNIT_NAMES = (
    *("m", "mm", "cm", "km", "s", "kg", "g", "t", "N", "kN", "MN", "Nm", "J", "Pa", "kPa", "MPa", "GPa"),
    *("bar", "inch", "ft", "lb", "lbf", "psi", "rad", "deg"),
)
"""Names of units that people try. One beside a number, as in 600mm, need not be listed."""
LETTER_SUBSTITUTES = {
    **{"π": "pi", "²": "**2", "³": "**3", "√": "sqrt"},
    **{"·": "*", "×": "*", "÷": "/", "−": "-", "–": "-"},
}
"""What to write for letters that formulas do not have."""
MODULE_PREFIXES = ("np", "numpy", "math", "sympy", "sp", "ufl")
"""What people write, with a point, before names that need nothing there."""
CONDITION_PATTERN = re.compile(r"[<>]|\bif\b")
COMMA_PATTERN = re.compile(r"(?<![\w.])(\d+),(\d+)")
"""A number with a decimal comma."""
THOUSANDS_PATTERN = re.compile(r"(?<![\w.,])[1-9]\d{0,2}(?:,\d{3})+(?![\d,])(\.\d*)?")
"""A number whose thousands are set off by commas; it has decimals or not."""
GROUPED_PATTERN = re.compile(
    r"(?<![\w.,])([1-9]\d{0,2}(?:(?:\.\d{3})+(?=,)|(?:[ ']\d{3})+))(?:[.,](\d+))?(?![\w.,])"
)
"""A number whose thousands are set off by points, before a decimal comma, or by blanks or apostrophes."""
PERCENT_PATTERN = re.compile(r"(?<![\w.])(\d+(?:\.\d*)?)\s*%")
UNFINISHED_EXPONENT = re.compile(r"(?<![\w.])\d+(?:\.\d*)?[eE](?![\w.]|[-+]\w)")
"""A power of ten without its exponent, such as 1e."""
LEADING_ZEROS = re.compile(r"(?<![\w.])0+([1-9]\d*)(?![\w.])")
MISSING_PRODUCT_SIGN = re.compile(
    r"(?<![\w.])(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*(?![eE][-+\d])([a-zA-Zπµμ°Ω]\w*|\()"
)
"""A number and what it multiplies without a sign, such as 2x."""
ONE_HALF = Fraction(1, 2)
OPERATORS: dict[type, Callable[[Expression, Expression], Expression]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a ** (b.rational or 0),
}
COUNTED_OPERATIONS = (ast.BinOp, ast.UnaryOp, ast.Call)


class ParsedFormula(NamedTuple):
    """The value of a part of a formula, an upper bound on its degree, and how deep functions nest in it."""

    value: Expression
    degree: float = 0.0
    function_depth: int = 0


def parse_syntax_tree(source: str, where: str) -> ast.expr:
    """The syntax tree of a formula.

    Raises InputError beyond a limit, and SyntaxError, ValueError, RecursionError or MemoryError, as Python's
    parser does, where there is no tree.
    """
    # Python's parser is slow or fails on what is very long or nested: limits are looked at before it runs
    nesting = max(accumulate((c == "(") - (c == ")") for c in source), default=0)
    _check_limit(len(source), MAX_LENGTH, f"{where}: the formula has more than {{}} characters")
    _check_limit(nesting, MAX_NESTING, f"{where}: the formula has more than {{}} nested parentheses")
    body = ast.parse(source, mode="eval").body
    operations = sum(isinstance(node, COUNTED_OPERATIONS) for node in ast.walk(body))
    _check_limit(operations, MAX_OPERATIONS, f"{where}: the formula has more than {{}} operations")
    return body


def _check_limit(size: int, limit: int, message: str) -> None:
    if size > limit:
        raise InputError(message.format(limit))


class FormulaReader(ast.NodeVisitor):
    """Makes a `ParsedFormula` of a syntax tree; raises InputError for what the grammar does not have."""

    def __init__(
        self, source: str, variables: Iterable[str], where: str, least_power: int | None = JUMP_POWER
    ) -> None:
        """`least_power` is the least power of pos that the place allows, None for a place without pos."""
        self.source = source
        self.where = where
        self.least_power = least_power
        self.names = {name: ParsedFormula(variable(name), 1.0) for name in variables}
        self.names["pi"] = ParsedFormula(variable("pi"))

    def refuse(self, node: ast.AST, why: str) -> InputError:
        """The InputError that a node of the tree is not allowed, with the reason."""
        return InputError(f"{self.where}: '{quote_input(self.text(node))}' {why}")

    def text(self, node: ast.AST) -> str:
        """The text of a node of the tree."""
        return ast.get_source_segment(self.source, node) or self.source

    def check_value(
        self, node: ast.AST, value: Callable[[], Expression], degree: float = 0.0, functions: int = 0
    ) -> ParsedFormula:
        """The part of a formula that a node is, whose `degree` and nested `functions` the caller knows.

        `value` computes it here, so that its errors are told of the node. The size of its numbers is bounded,
        so that the next operation ends soon.
        """
        try:
            result = value()
            numbers = [*(c for _, c in result.terms), *(k for powers, _ in result.terms for _, k in powers)]
            if any(max(map(int.bit_length, n.as_integer_ratio())) > MAX_BITS for n in numbers):
                raise self.refuse(node, "has a number that is too large or too small")
            finite = is_finite_and_real(result)
            # a number may be 0 without being written so
            if not result.variables and finite and sign(result) == 0:
                result = ZERO
        except ArithmeticError:
            finite = False
        except ValueError:
            raise self.refuse(node, "cannot be distinguished from 0; write it as a single number") from None
        if not finite:
            raise self.refuse(node, "is not a finite real number or function")
        return ParsedFormula(result, degree, functions if result.variables else 0)

    def generic_visit(self, node: ast.AST) -> ParsedFormula:
        """Raises InputError for a node that the grammar does not have."""
        raise self.refuse(node, "is not allowed in a formula")

    def visit_Compare(self, node: ast.AST) -> ParsedFormula:
        """Raises InputError for a condition, with what to write instead."""
        raise self.refuse(node, f"is not allowed in a formula{condition_hint(self.names, self.least_power)}")

    visit_IfExp = visit_Compare

    def visit_Attribute(self, node: ast.Attribute) -> ParsedFormula:
        """Raises InputError for a name with a point, with the hint to leave out a module."""
        raise self.refuse(node, f"is not allowed in a formula{self.module_hint(node)}")

    def visit_Subscript(self, node: ast.Subscript) -> ParsedFormula:
        """Raises InputError for an index, with the hint to write x and y, or numbers without units."""
        point = quote_input(self.text(node.value))
        hint = f"; write x for {point}[0] and y for {point}[1]" if {"x", "y"} <= {*self.names} else ""
        hint = NO_UNITS if isinstance(node.value, ast.Constant) else hint
        raise self.refuse(node, f"is not allowed in a formula{hint}")

    def module_hint(self, node: ast.expr) -> str:
        """The hint to leave out the module before a name such as np.sin."""
        if not isinstance(node, ast.Attribute) or self.text(node.value) not in MODULE_PREFIXES:
            return ""
        is_known = node.attr in (*self.names, *FUNCTION_ARITIES)
        return substitution_hint(node.attr, self.text(node)) if is_known else ""

    def visit_Tuple(self, node: ast.Tuple) -> ParsedFormula:
        """Raises InputError for a comma, with the hint to write a point."""
        raise self.refuse(node, f"is not allowed in a formula{comma_hint(self.text(node))}")

    def visit_Constant(self, node: ast.Constant) -> ParsedFormula:
        """The exact value of a decimal number."""
        try:
            value = Decimal(self.text(node))
        except InvalidOperation:
            raise self.refuse(node, "is not a decimal number") from None
        if abs(value.adjusted()) > MAX_BITS:
            raise self.refuse(node, "has a number that is too large or too small")
        return self.check_value(node, lambda: rational_expression(Fraction(value)))

    def visit_Name(self, node: ast.Name) -> ParsedFormula:
        """The variable, constant or pi of that name."""
        if node.id in FUNCTION_ARITIES:
            argument = "(a, k)" if FUNCTION_ARITIES[node.id] > 1 else "(a)"
            raise self.refuse(node, f"is a function; write its argument after it, as in {node.id}{argument}")
        if node.id not in self.names:
            instead = name_hint(node.id, self.names)
            choices = f"; known are {', '.join(self.names)}, {OFFERED_FUNCTIONS}"
            raise self.refuse(node, f"is unknown{instead or choices}")
        return self.names[node.id]

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ParsedFormula:
        """A formula with its sign."""
        if not isinstance(node.op, ast.USub | ast.UAdd):
            raise self.refuse(node, "is not allowed in a formula")
        operand = self.visit(node.operand)
        return operand._replace(value=-operand.value) if isinstance(node.op, ast.USub) else operand

    def visit_BinOp(self, node: ast.BinOp) -> ParsedFormula:
        """Follows a chain such as a + b + c by a loop; it may be longer than Python's recursion is deep."""
        chain = [node]
        while isinstance(chain[-1].left, ast.BinOp):
            chain.append(chain[-1].left)
        result: ParsedFormula = self.visit(chain[-1].left)
        for operation in reversed(chain):
            result = self.combine(operation, result, self.visit(operation.right))
        return result

    def combine(self, node: ast.BinOp, a: ParsedFormula, b: ParsedFormula) -> ParsedFormula:
        """The part of a formula that an operator makes of two."""
        if type(node.op) not in OPERATORS:
            text = self.text(node)
            power = substitution_hint(text.replace("^", "**"), text) if "^" in text else ""
            raise self.refuse(node, f"uses an operator other than + - * / **{power}")
        degree = max(a.degree, b.degree)
        functions = max(a.function_depth, b.function_depth)
        if isinstance(node.op, ast.Pow):
            k = b.value.rational
            if k is None or abs(k) > MAX_DEGREE:
                raise self.refuse(node, f"needs a rational exponent between -{MAX_DEGREE} and {MAX_DEGREE}")
            self.check_kink(node, a.value, k)
            # k may be below 0: the degree bounds the work of multiplying out numerator and denominator
            degree = a.degree * abs(float(k))
            functions = functions + (k.denominator > 1)  # a root is a function
        elif isinstance(node.op, ast.Mult | ast.Div):
            degree = a.degree + b.degree
        self.check_limits(node, degree, functions)
        operator = OPERATORS[type(node.op)]
        return self.check_value(node, lambda: operator(a.value, b.value), degree, functions)

    def visit_Call(self, node: ast.Call) -> ParsedFormula:
        """The value of a function of the grammar."""
        if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTION_ARITIES or node.keywords:
            raise self.refuse_call(node, self.text(node.func))
        function = node.func.id
        arity = FUNCTION_ARITIES[node.func.id]
        if len(node.args) != arity:
            hint = comma_hint(self.text(node)) if len(node.args) > arity else ""
            raise self.refuse(node, f"takes {arity} argument{'s' if arity > 1 else ''}{hint}")
        arguments = [self.visit(argument) for argument in node.args]
        values = [argument.value for argument in arguments]
        degree = arguments[0].degree
        if function == "pos":
            degree *= self.check_power(node, *arguments)
        functions = 1 + arguments[0].function_depth
        self.check_limits(node, degree, functions)
        if function == "sqrt":
            self.check_kink(node, values[0], ONE_HALF)
            return self.check_value(node, lambda: values[0] ** ONE_HALF, degree, functions)
        return self.check_value(node, lambda: apply_function(function, *values), degree, functions)

    def refuse_call(self, node: ast.Call, name: str) -> InputError:
        """The refusal of a call of what is no function; it may have been meant as a factor."""
        if isinstance(node.func, ast.Constant) or name in self.names:
            factors = quote_input(f"{name}*{self.text(node).removeprefix(name).strip()}")
            return self.refuse(node, f"is not a product; write {factors}")
        least_power, instead = FUNCTION_SUBSTITUTES.get(name, (NO_POWER, ""))
        # what is written with a power of pos that the place does not allow cannot be offered there
        if least_power != NO_POWER and (self.least_power is None or least_power < self.least_power):
            hint = positive_part_hint(self.names, self.least_power)
            return self.refuse(node, f"is not a known function{hint}")
        lower = name.lower()
        if not instead and lower in FUNCTION_ARITIES and not node.keywords:
            instead = f"{lower} for {name}"
        hint = f"; write {instead}" if instead else self.module_hint(node.func)
        return self.refuse(node, f"is not a known function{hint or f'; known are {OFFERED_FUNCTIONS}'}")

    def check_limits(self, node: ast.AST, degree: float, functions: int) -> None:
        """Raises InputError for a degree or a nesting of functions beyond the limits."""
        if degree > MAX_DEGREE:
            why = f"has the degree {degree:g} when multiplied out; at most {MAX_DEGREE} is allowed"
            raise self.refuse(node, why)
        if functions > MAX_FUNCTIONS:
            raise self.refuse(node, f"has more than {MAX_FUNCTIONS} nested functions")

    def check_kink(self, node: ast.AST, base: Expression, k: Fraction) -> None:
        """Raises InputError for a power that is one of an absolute value, such as (x^2)^(1/2)."""
        if hides_kink(base, k):
            raise self.refuse(node, "has a kink; write pos(a, 1) + pos(-a, 1) for abs(a)")

    def check_power(self, node: ast.AST, argument: ParsedFormula, power: ParsedFormula) -> float:
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
        return bool(value.variables) or math.isfinite(as_float(value))
    except ArithmeticError:
        return False


def condition_hint(names: Iterable[str], least_power: int | None) -> str:
    """The hint that there are no conditions, and what to write instead, after a semicolon."""
    return f"; {NO_CONDITION}{positive_part_hint(names, least_power)}"


def positive_part_hint(names: Iterable[str], least_power: int | None) -> str:
    """How pos acts with the least power that a place allows, after a semicolon; "" for one without pos."""
    variable = next((name for name in names if name != "pi"), None)
    if least_power is None or variable is None:
        return ""
    if least_power == JUMP_POWER:
        example = f"such as pos({variable} - 1/2, 0) for {variable} > 1/2"
        return f"; pos(a, 0) is 1 where a > 0 and 0 elsewhere, {example}"
    power = "a" if least_power == KINK_POWER else f"a**{least_power}"
    return f"; pos(a, {least_power}) is {power} where a > 0 and 0 elsewhere; jumps are not allowed here"


def name_hint(name: str, allowed: Iterable[str]) -> str:
    """The hint what to write for an unknown name, after a semicolon; "" where that cannot be guessed."""
    if name in UNIT_NAMES:
        return NO_UNITS
    if name in ("e", "E"):
        return substitution_hint("exp(1)", name)
    instead = LETTER_SUBSTITUTES.get(name, name.lower())
    is_known = instead in (*allowed, *FUNCTION_ARITIES)
    return substitution_hint(instead, name) if is_known and instead != name else ""


def substitution_hint(replacement: str, original: str) -> str:
    """The hint to write something else, after a semicolon; both texts are cut if they are long."""
    return f"; write {quote_input(replacement)} for {quote_input(original)}"


def syntax_hint(source: str, names: Sequence[str], least_power: int | None) -> str:
    """How to mend what Python's parser refused, after a semicolon; nothing where that cannot be guessed."""
    if CONDITION_PATTERN.search(source):
        return condition_hint(names, least_power)
    if hint := product_hint(source, names):
        return hint
    if letter := next((letter for letter in source if letter in LETTER_SUBSTITUTES), ""):
        return substitution_hint(LETTER_SUBSTITUTES[letter], letter)
    if percent := PERCENT_PATTERN.search(source):
        return substitution_hint(f"{percent[1]}/100", percent[0])
    if UNFINISHED_EXPONENT.search(source):
        return "; write the exponent of a power of ten, such as 1e-3, and exp(1) for the number e"
    if zeros := LEADING_ZEROS.search(source):
        return comma_hint(source) or substitution_hint(zeros[1], zeros[0])
    return comma_hint(source)


def product_hint(source: str, names: Sequence[str]) -> str:
    """How to write a product without its sign, or a number with its unit; "" where there is neither."""
    product = MISSING_PRODUCT_SIGN.search(source)
    if product is None or UNFINISHED_EXPONENT.search(source):
        return ""
    factor = LETTER_SUBSTITUTES.get(product[2], product[2])
    if factor in (*names, "pi", *FUNCTION_ARITIES, "("):
        return substitution_hint(f"{product[1]}*{factor}", product[0])
    if {*factor} <= {*names}:
        return substitution_hint("*".join((product[1], *factor)), product[0])
    # x, y and z are no units, but coordinates, which this place does not have
    return "" if factor in ("x", "y", "z") else NO_UNITS


def comma_hint(source: str) -> str:
    """How to write a number with a comma, or with its thousands set off; "" where there is none."""
    if grouped := GROUPED_PATTERN.search(source):
        decimals = f".{grouped[2]}" if grouped[2] else ""
        return substitution_hint(re.sub(r"\D", "", grouped[1]) + decimals, grouped[0])
    if thousands := THOUSANDS_PATTERN.search(source):
        integer = thousands[0].replace(",", "")
        decimals = thousands[0].replace(",", ".")
        # 1,234 may mean 1234 or 1.234; with a point or two commas it is the former
        clear = thousands[1] or thousands[0].count(",") > 1
        return substitution_hint(integer if clear else f"{integer} or {decimals}", thousands[0])
    pair = COMMA_PATTERN.search(source)
    return substitution_hint(f"{pair[1]}.{pair[2]}", pair[0]) if pair else ""
