"""Reads problems from YAML files, and refuses those that cannot be solved, with the file and the field."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from fractions import Fraction
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.errors import InputError, shown
from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ZERO, Expression, atoms_in, product, roots_in
from unilateral.formulas.formula import number
from unilateral.geometry.polygon import MAX_VERTICES, TOO_MANY, Polygon, named, names
from unilateral.problems import catalogue
from unilateral.problems.data_checks import check
from unilateral.problems.formula_range import range_in, range_on_side
from unilateral.problems.problem import Problem, curve
from unilateral.problems.scaled import scaled_polygon
from unilateral.problems.side_fields import on_sides, plain, trace, without_contact
from unilateral.problems.units import Units
from unilateral.system import declarations

FIELDS = {"polygon", "f", "g", "free_sides"}
MOST_COEFFICIENT = 1e30
"""The largest k and c; the smallest is 1 over this."""


def is_declared_in(name: str) -> bool:
    """Whether this is a YAML file with a field that only problems have, not a case."""
    if name in catalogue.names():
        return False
    file = declarations.file_of(name)
    if file is None:
        return False
    declaration = declarations.read(file, name)
    if not isinstance(declaration, dict) or not declaration:
        raise InputError(
            f"{name} has no fields; a problem has at least polygon and f, a case title, polygons and u"
        )
    return not FIELDS.isdisjoint(declaration)


def load(name: str) -> Problem:
    """The problem declared in a YAML file.

    Raises InputError, with the field, for what the schema does not allow, for a polygon that is not simple
    and anticlockwise, and for f, g and q that are not finite, not smooth enough, or do not fit together.
    """
    return made(declarations.read(Path(name), name), name)


def polygon_of(name: str) -> Polygon:
    """The polygon of that name, or the one in a YAML file, whose field `polygon` is that of a problem.

    Raises InputError as for a problem.
    """
    return domain_of(name).polygon


def domain_of(name: str) -> Problem:
    """The problem with f = g = u = 0 on that polygon, with the clamped sides that the file has; k = 1.

    c is 0 if it is so in the file, and else 1.
    """
    file = None if name in names() else declarations.file_of(name)
    if file is None:
        polygon = named(name)
        return Problem(name, polygon, ZERO, (ZERO,) * polygon.n_sides, ())
    declaration = declarations.read(file, name)
    if not isinstance(declaration, dict) or "polygon" not in declaration:
        raise InputError(f"{name}: the field polygon is missing; it lists the vertices, anticlockwise")
    given = declaration.get("u")
    clamped = given if isinstance(given, dict) else {}
    c = number(declaration.get("c", 1), f"{name}, field c")
    fields = {"u": dict.fromkeys(clamped, 0), "c": 0 if c == ZERO else 1}
    return made({"polygon": declaration["polygon"], "f": 0, "g": 0} | fields, name, file.name)


def made(declaration: Any, where: str, name: str | None = None) -> Problem:
    """The problem with the fields of a declaration; errors begin with `where` these come from.

    Its name is by default that of the file `where`, without the ending.
    """
    schema = resources.files("unilateral.problems") / "problem.schema.yaml"
    declaration = declarations.validate(declaration, schema, where)
    name = Path(where).stem if name is None else name
    if len(declaration["polygon"]) > MAX_VERTICES:
        raise InputError(f"{where}, field polygon: {TOO_MANY.format(len(declaration['polygon']))}")
    corners = [
        [number(x, f"{where}, field polygon[{i}]") for x in vertex]
        for i, vertex in enumerate(declaration["polygon"])
    ]
    try:
        polygon = Polygon(np.array([[rounded(x) for x in vertex] for vertex in corners]), name)
    except InputError as error:
        raise InputError(f"{where}, field polygon: {error}") from None
    k, c = (_coefficient(declaration.get(of, 1), f"{where}, field {of}", or_0=of == "c") for of in "kc")
    free, clamped = without_contact(declaration, polygon.n_sides, where)
    units = Units(k, c)
    if not (clamped or units.reaction):
        raise InputError(
            f"{where}, field c: it is 0 and no side is clamped, so that u is not unique; clamp a side in the "
            "field u, or take a c above 0"
        )
    f = formula(declaration["f"], f"{where}, field f")
    ends = [*zip(corners, corners[1:] + corners[:1], strict=True)]
    g, q = (
        on_sides(field, declaration.get(field), ends, free, clamped, f"{where}, field {field}")
        for field in "gq"
    )
    for side, text in clamped.items():
        place = f"{where}, field u[{side}]"
        g[side] = trace(plain(text, place, "u"), ends[side], side, place)
    given = name, polygon, f, tuple(g), free, units, tuple(q)
    problem = Problem(*given, title=declaration.get("title", ""), clamped_sides=tuple(clamped))
    try:
        scaled_polygon(problem)
    except InputError as error:
        raise InputError(f"{where}, fields k and c: scaled by (c/k)^(1/2), {error}") from None
    check_roots(problem, where)
    check(problem, where)
    return problem


def _coefficient(given: object, where: str, or_0: bool = False) -> Expression:
    """An exact number that is positive, `or_0`, and of a size that leaves room for those of the data."""
    coefficient = number(given, where)
    if or_0 and coefficient == ZERO:
        return coefficient
    if not 1 / MOST_COEFFICIENT <= rounded(coefficient) <= MOST_COEFFICIENT:
        raise InputError(
            f"{where}: it is {shown(given)}; it has to be a positive number, "
            f"between {1 / MOST_COEFFICIENT:g} and {MOST_COEFFICIENT:g}" + ", or 0" * or_0
        )
    return coefficient


def check_roots(problem: Problem, name: str) -> None:
    """Raises InputError unless every root in f, g, u and q is taken of what is above 0 in its place.

    Guaranteed ranges of the roots decide that.
    """
    for root in _roots(problem.f):
        if not np.isfinite(range_in(problem.polygon, root)).all():
            raise InputError(f"{name}, field f: {_needs(root, 'in the polygon', formula)}")
    for side in range(problem.polygon.n_sides):
        free = side in problem.free_sides
        field = "q" if free else "u" if side in problem.clamped_sides else "g"
        formulas = problem.q if free else problem.g
        for root in _roots(formulas[side]) if formulas else ():
            if not np.isfinite(range_on_side(problem.polygon, root, side)).all():
                read = partial(plain, field=field) if free else None
                raise InputError(f"{name}, field {field}: {_needs(root, f'on side {side}', read)}")


def _roots(formula: Expression) -> list[Expression]:
    """The powers in a formula whose exponents are no whole numbers."""
    return [product(1, [power]) for power in roots_in(formula)]


def _needs(root: Expression, place: str, read: Callable[[object, str], object] | None) -> str:
    """What a root needs, and the positive part that can be written in its place if it can be `read`."""
    ((base, k),) = root.factors[1]
    radicand = product(1, [(base, Fraction(1))])
    needs, instead = f"{shown(root)} needs {shown(radicand)} > 0 {place}", f"pos({radicand}, {k})"
    with suppress(InputError):
        if read:
            read(instead, "")
            return f"{needs}; write {instead}, which is 0 elsewhere"
    return needs if read else f"{needs}; a root is not Lipschitz where it is 0"


def formula(text: object, where: str) -> Expression:
    """f as a formula in x, y whose kinks can be found; see `made`."""
    f = plain(text, where, "f")
    for power in atoms_in(f, "pos"):
        try:
            curve(power.args[0])
        except ValueError as error:
            raise InputError(f"{where}: the argument of {power} {error}") from None
    return f
