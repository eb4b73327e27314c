"""Reads problems from YAML files, and refuses those that cannot be solved, with the file and the field."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.errors import InputError, shown
from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ZERO
from unilateral.formulas.formula import number
from unilateral.geometry.polygon import Polygon, named, names
from unilateral.problems import catalogue
from unilateral.problems.build import build, check_count, make_polygon
from unilateral.problems.problem import Problem
from unilateral.system import declarations

FIELDS = {"polygon", "f", "g", "free_sides"}
JOINED = re.compile(r"([-+]?\d+):(\S+)")
"""A side and its formula that YAML reads as one text, for want of a blank."""


def is_declared_in(name: str) -> bool:
    """Whether this is a YAML file with a field that only problems have, not a case."""
    return _declaration(name) is not None


def problem_in(name: str) -> Problem | None:
    """The problem that a YAML file declares; None for the name or the file of a case. Raises InputError."""
    declaration = _declaration(name)
    return None if declaration is None else made(declaration, name)


def _declaration(name: str) -> dict[str, Any] | None:
    """What a YAML file declares if it has a field that only problems have."""
    if name in catalogue.names():
        return None
    file = declarations.file_of(name)
    if file is None:
        return None
    declaration = declarations.read(file, name)
    if not isinstance(declaration, dict) or not declaration:
        raise InputError(
            f"{name} has no fields; a problem has at least polygon and f, a case title, polygons and u"
        )
    return None if FIELDS.isdisjoint(declaration) else declaration


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
    check_count(declaration["polygon"], where)
    corners = [
        [number(x, f"{where}, field polygon[{i}]") for x in vertex]
        for i, vertex in enumerate(declaration["polygon"])
    ]
    polygon = make_polygon(np.array([[rounded(x) for x in vertex] for vertex in corners]), name, where)
    return build(
        name,
        polygon,
        corners,
        declaration["f"],
        declaration.get("g"),
        free_sides=declaration.get("free_sides"),
        k=declaration.get("k", 1),
        c=declaration.get("c", 1),
        q=declaration.get("q"),
        u=_clamped_sides(declaration.get("u", {}), where),
        where=where,
        title=declaration.get("title", ""),
    )


def _clamped_sides(given: dict[str, Any], where: str) -> list[tuple[Any, Any]]:
    """The field u as pairs of a side, a number where it is written as one, and what u is there."""
    for key in given:
        if joined := JOINED.fullmatch(key):
            blank = f"the colon in '{shown(key)}' needs a blank after it"
            raise InputError(f"{where}, field u: {blank}; write {{{shown(': '.join(joined.groups()))}}}")
    return [(int(key) if declarations.INTEGER.match(key) else key, value) for key, value in given.items()]
