"""The problem of a certificate, in exact numbers: fractions, terms of polynomials, texts of formulas."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from unilateral.errors import InputError
from unilateral.formulas.expression import ZERO, Expression, atoms_in
from unilateral.formulas.formula import coefficients
from unilateral.geometry.polygon import Polygon
from unilateral.problems.problem import Problem
from unilateral.problems.sampled import Function, Sampled

if TYPE_CHECKING:
    from unilateral.problems.given import AnyProblem

MAX_DENOMINATOR = 10**6
"""A double is taken for the simplest fraction that rounds to it, if that has at most this denominator."""
MAX_DEGREE, MAX_FORMULA_LENGTH = 20, 2000
"""The checkers read no polynomials of a higher degree, and no longer texts."""
UNREAD = "which no checker of certificates reads"
INSTEAD = "write the field otherwise, or leave the certificate out"
FIELDS = {"contact": "g", "free": "q", "clamped": "u"}
"""The field of a problem that has the function of each condition."""
Point = tuple[Fraction, Fraction]
Terms = list[tuple[int, int, Fraction]]
"""(i, j, c) for each term c x^i y^j of a polynomial."""


def state_problem(problem: AnyProblem) -> dict[str, Any]:
    """The field `problem` of a certificate, see docs/certificate.md.

    Raises InputError for what no checker reads: cases, functions, arrays at nodes, pos, irrational k and c,
    and u that is not quadratic along its side.
    """
    name = problem.name
    if not isinstance(problem, Problem | Sampled):
        raise InputError(f"'{name}' is a case, {UNREAD}; take a problem file, or leave the certificate out")
    vertices, clamped, free = corners(problem.polygon), problem.clamped_sides, problem.free_sides
    f, text = _read_function(problem.f, problem.nodal.f is not None, f"{name}, field f")
    sides: list[dict[str, Any]] = []
    for side, start in enumerate(vertices):
        kind = "clamped" if side in clamped else "free" if side in free else "contact"
        place = f"{name}, field {FIELDS[kind]}[{side}]"
        data, arrays = (problem.q, problem.nodal.q) if kind == "free" else (problem.g, problem.nodal.g)
        terms, formula = _read_function(data[side] if data else ZERO, side in arrays, place)
        is_quadratic = terms is not None and _is_quadratic(terms, start, vertices[(side + 1) % len(vertices)])
        if kind == "clamped" and not is_quadratic:
            raise InputError(f"{place}: it is no quadratic polynomial with fractions, {UNREAD}; {INSTEAD}")
        sides.append({kind: _written(terms) if terms is not None and is_quadratic else formula})
    return {
        "k": _written_fraction(problem.units.k, f"{name}, field k"),
        "c": _written_fraction(problem.units.c, f"{name}, field c"),
        "polygon": [[str(x), str(y)] for x, y in vertices],
        "f": _written(f) if f is not None and _degree(f) <= 2 else text,
        "sides": sides,
    }


def has_formulas(statement: dict[str, Any]) -> bool:
    """Whether a function of a stated problem is the text of a formula."""
    functions = [statement["f"], *(function for side in statement["sides"] for function in side.values())]
    return any(isinstance(function, str) for function in functions)


def corners(polygon: Polygon) -> list[Point]:
    """The exact vertices: the simplest fractions that round to the doubles, else their decimals."""
    return [(_simplest_fraction(x), _simplest_fraction(y)) for x, y in polygon.vertices.tolist()]


def _simplest_fraction(z: float) -> Fraction:
    fraction = Fraction(z).limit_denominator(MAX_DENOMINATOR)
    return fraction if float(fraction) == z else Fraction(repr(z))


def _written_fraction(number: Expression, place: str) -> str:
    if number.rational is None:
        raise InputError(f"{place}: {number} is irrational, {UNREAD}; {INSTEAD}")
    return str(number.rational)


def _read_function(data: Expression | Function, is_array: bool, place: str) -> tuple[Terms | None, str]:
    """The terms of a polynomial with fractions, None for any other formula; and the formula's text."""
    formula = getattr(data, "formula", data)
    if is_array or not isinstance(formula, Expression):
        raise InputError(f"{place}: it is {'an array' if is_array else 'a function'}, {UNREAD}; {INSTEAD}")
    if atoms_in(formula, "pos"):
        raise InputError(f"{place}: it has pos, {UNREAD}; {INSTEAD}")
    text = str(formula)
    if len(text) > MAX_FORMULA_LENGTH:
        raise InputError(f"{place}: it has {len(text)} characters, {UNREAD}; {INSTEAD}")
    try:
        polynomial = coefficients(formula, "xy")
    except ValueError:  # a coefficient cannot be distinguished from 0
        polynomial = None
    if polynomial is None or any(c.rational is None for c in polynomial.values()):
        return None, text
    terms = [(i, j, c.rational) for (i, j), c in sorted(polynomial.items()) if c.rational is not None]
    return (terms if _degree(terms) <= MAX_DEGREE else None), text


def _written(terms: Terms) -> list[list[Any]]:
    return [[i, j, str(c)] for i, j, c in terms]


def _degree(terms: Terms) -> int:
    return max((i + j for i, j, _ in terms), default=0)


def _is_quadratic(terms: Terms, start: Point, end: Point) -> bool:
    """Whether a polynomial is quadratic along a side, which means that its third differences are 0 there."""
    (x, y), dx, dy = start, end[0] - start[0], end[1] - start[1]
    places = [(x + step * dx, y + step * dy) for step in range(_degree(terms) + 1)]
    values = [sum(c * x**i * y**j for i, j, c in terms) for x, y in places]
    thirds = zip(values, values[1:], values[2:], values[3:], strict=False)
    return not any(d - 3 * c + 3 * b - a for a, b, c, d in thirds)
