"""The problem of a certificate, in exact numbers: fractions, terms of polynomials, texts of formulas."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

from unilateral.errors import InputError
from unilateral.formulas.expression import ZERO, Expression, find_functions
from unilateral.formulas.formula import polynomial_coefficients
from unilateral.problems.side_tables import SideTable

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem

MAX_STATED_DENOMINATOR = 10**6
"""A double is taken for the simplest fraction that rounds to it, if that has at most this denominator."""
MAX_STATED_DEGREE = 20
"""Polynomials of a higher degree are written as formulas."""
CONDITION_FIELDS = {"contact": "g", "free": "q", "clamped": "u"}
"""The field of a problem that has the function of each condition."""
Point = tuple[Fraction, Fraction]
Terms = list[tuple[int, int, Fraction]]
"""(i, j, c) for each term c x^i y^j of a polynomial."""


def state_problem(problem: Problem) -> dict[str, Any]:
    """The field `problem` of a certificate, see docs/certificate.md.

    Raises InputError for what no checker reads: cases, values at nodes, pos, irrational k and c,
    and u that is not quadratic along its side.
    """
    name = problem.name
    sides = list[dict[str, Any]]()
    if problem.exact:
        raise _unread_error(f"'{name}'", "is a case", "take a problem file")
    vertices = [(_simplest_fraction(x), _simplest_fraction(y)) for x, y in problem.polygon.vertices.tolist()]
    for side, start in enumerate(vertices):
        kind = "clamped" if side in problem.clamped_sides else "contact"
        kind = "free" if side in problem.free_sides else kind
        place = f"{name}, field {CONDITION_FIELDS[kind]}[{side}]"
        data = problem.q if kind == "free" else problem.g  # g is u_D on clamped sides
        is_exact = partial(_is_quadratic, start, vertices[(side + 1) % len(vertices)])
        function = _state_function(data[side] if data else ZERO, place, is_exact)
        if kind == "clamped" and isinstance(function, str):
            raise _unread_error(f"{place}:", "it is no quadratic polynomial with fractions")
        sides.append({kind: function})
    return {
        "k": _state_number(problem.k, f"{name}, field k"),
        "c": _state_number(problem.c, f"{name}, field c"),
        "polygon": [[str(x), str(y)] for x, y in vertices],
        "f": _state_function(problem.f, f"{name}, field f", lambda terms: _degree(terms) <= 2),
        "sides": sides,
    }


def has_formulas(statement: dict[str, Any]) -> bool:
    """Whether a function of a stated problem is the text of a formula."""
    functions = [statement["f"], *(function for side in statement["sides"] for function in side.values())]
    return any(isinstance(function, str) for function in functions)


def _unread_error(where: str, fault: str, advice: str = "write the field otherwise") -> InputError:
    unread = "which no checker of certificates reads"
    return InputError(f"{where} {fault}, {unread}; {advice}, or leave the certificate out")


def _simplest_fraction(z: float) -> Fraction:
    """The simplest fraction that rounds to a double, or the double's decimal."""
    fraction = Fraction(z).limit_denominator(MAX_STATED_DENOMINATOR)
    return fraction if float(fraction) == z else Fraction(repr(z))


def _state_number(number: Expression, where: str) -> str:
    if number.rational is None:
        raise _unread_error(f"{where}:", f"{number} is irrational")
    return str(number.rational)


def _state_function(formula: object, where: str, is_exact: Callable[[Terms], bool]) -> list[list[Any]] | str:
    """The terms of a polynomial with fractions, if `is_exact` says that it is read as one; else a formula."""
    if isinstance(formula, SideTable):
        raise _unread_error(f"{where}:", "it is a table")
    if not isinstance(formula, Expression):
        raise _unread_error(f"{where}:", "it is linear between the nodes of the mesh")
    if find_functions(formula, "pos"):
        raise _unread_error(f"{where}:", "it has pos")
    try:
        polynomial = polynomial_coefficients(formula, "xy")
    except ValueError:  # a coefficient cannot be distinguished from 0
        polynomial = None
    items = sorted((polynomial or {}).items())
    terms = [(i, j, c.rational) for (i, j), c in items if c.rational is not None]
    is_polynomial = polynomial is not None and len(terms) == len(items)
    if is_polynomial and _degree(terms) <= MAX_STATED_DEGREE and is_exact(terms):
        return [[i, j, str(c)] for i, j, c in terms]
    return str(formula)


def _degree(terms: Terms) -> int:
    return max((i + j for i, j, _ in terms), default=0)


def _is_quadratic(start: Point, end: Point, terms: Terms) -> bool:
    """Whether a polynomial is quadratic along a side: its third differences are 0 there."""
    x, y = start
    dx = end[0] - start[0]
    dy = end[1] - start[1]
    places = [(x + step * dx, y + step * dy) for step in range(_degree(terms) + 1)]
    values = [sum(c * x**i * y**j for i, j, c in terms) for x, y in places]
    thirds = zip(values, values[1:], values[2:], values[3:], strict=False)
    return not any(d - 3 * c + 3 * b - a for a, b, c, d in thirds)
