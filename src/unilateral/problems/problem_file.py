"""Reads problems from YAML files, and refuses those that cannot be solved, with the file and the field."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.errors import InputError, quote_input
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import ZERO, Expression
from unilateral.formulas.formula import parse_number
from unilateral.geometry.polygon import Polygon, find_polygon, polygon_names
from unilateral.problems import arguments, catalogue
from unilateral.problems.build import build_problem, check_vertex_count, make_polygon
from unilateral.problems.polygon_file import read_polygon
from unilateral.problems.problem import Problem
from unilateral.problems.reading import exact_vertices
from unilateral.system import declarations

PROBLEM_FIELDS = {"polygon", "f", "g", "free_sides"}
UNSPACED_SIDE = re.compile(r"([-+]?\d+|\w+):(\S+)")
"""A side and its formula that YAML reads as one text, for want of a blank."""


def is_problem_file(name: str) -> bool:
    """Whether this is a YAML file with a field that only problems have, not a case."""
    return _read_problem_declaration(name) is not None


def load_if_problem(name: str) -> Problem | None:
    """The problem that a YAML file declares; None for the name or the file of a case. Raises InputError."""
    declaration = _read_problem_declaration(name)
    return None if declaration is None else build_from_declaration(declaration, name)


def _read_problem_declaration(name: str) -> dict[str, Any] | None:
    """The declaration in a YAML file if it has a field that only problems have, else None."""
    if name in catalogue.case_names():
        return None
    file = declarations.find_yaml_file(name)
    if file is None:
        return None
    declaration = declarations.read_declaration(file, name)
    if not isinstance(declaration, dict) or not declaration:
        raise InputError(
            f"{name} has no fields; a problem has at least polygon and f, a case title, polygons and u"
        )
    return None if PROBLEM_FIELDS.isdisjoint(declaration) else declaration


def load_problem(name: str) -> Problem:
    """The problem declared in a YAML file.

    Raises InputError, with the field, for what the schema does not allow, for a polygon that is not simple
    and anticlockwise, and for f, g and q that are not finite, not smooth enough, or do not fit together.
    """
    return build_from_declaration(declarations.read_declaration(Path(name), name), name)


def load_polygon(name: str) -> Polygon:
    """The polygon of that name, or the one in a YAML file, whose field `polygon` is that of a problem.

    Raises InputError as for a problem.
    """
    return load_domain(name).polygon


def load_domain(name: str) -> Problem:
    """The problem with f = g = u = 0 on that polygon, with the clamped sides that the file has; k = 1.

    c is 0 if it is so in the file, and else 1.
    """
    file = None if name in polygon_names() else declarations.find_yaml_file(name)
    if file is None:
        polygon = find_polygon(name)
        return Problem(name, polygon, ZERO, (ZERO,) * polygon.n_sides, ())
    declaration = declarations.read_declaration(file, name)
    if not isinstance(declaration, dict) or "polygon" not in declaration:
        raise InputError(f"{name}: the field polygon is missing; it lists the vertices, anticlockwise")
    clamped_field = declaration.get("u")
    clamped = clamped_field if isinstance(clamped_field, dict) else {}
    c = parse_number(declaration.get("c", 1), f"{name}, field c")
    fields = {"u": dict.fromkeys(clamped, 0), "c": 0 if c == ZERO else 1}
    domain = {key: declaration[key] for key in ("polygon", "side_names") if key in declaration}
    return build_from_declaration(domain | {"f": 0, "g": 0} | fields, name, file.name)


def build_from_declaration(declaration: Any, where: str, name: str | None = None) -> Problem:
    """The problem with the fields of a declaration; errors begin with `where`, the file they come from.

    Its name is by default that of the file `where`, without the ending.
    """
    schema = resources.files("unilateral.problems") / "problem.schema.yaml"
    declaration = declarations.validate(declaration, schema, where)
    name = Path(where).stem if name is None else name
    folder = Path(where).parent
    polygon, corners = _read_polygon_field(declaration, name, where)
    return build_problem(
        name,
        polygon,
        corners,
        declaration["f"],
        _locate_tables(_number_sides(declaration.get("g"), "g", where), folder),
        free_sides=declaration.get("free_sides"),
        k=declaration.get("k", 1),
        c=declaration.get("c", 1),
        q=_locate_tables(_number_sides(declaration.get("q"), "q", where), folder),
        u=_locate_tables(_number_sides(declaration.get("u", {}), "u", where), folder).items(),
        where=where,
        title=declaration.get("title", ""),
    )


def _read_polygon_field(
    declaration: dict[str, Any], name: str, where: str
) -> tuple[Polygon, list[list[Expression]]]:
    """The polygon and its exact vertices, from a list or from the file that is named, beside `where`."""
    vertices_or_file = declaration["polygon"]
    side_names = declaration.get("side_names", {})
    if isinstance(vertices_or_file, str):
        path = Path(where).parent / vertices_or_file
        polygon = read_polygon(path, name, f"{where}, field polygon", side_names)
        return polygon, exact_vertices(polygon)
    check_vertex_count(vertices_or_file, where)
    corners = [
        [parse_number(x, f"{where}, field polygon[{i}]") for x in vertex]
        for i, vertex in enumerate(vertices_or_file)
    ]
    rounded = np.array([[as_float(x) for x in vertex] for vertex in corners])
    return make_polygon(rounded, name, where, side_names), corners


def _number_sides(entries: Any, field: str, where: str) -> Any:
    """The entries of a field by the numbers of their sides; a field that is no mapping of sides unchanged."""
    if not isinstance(entries, dict) or "table" in entries:
        return entries
    for key in entries:
        if joined := UNSPACED_SIDE.fullmatch(key):
            blank = f"the colon in '{quote_input(key)}' needs a blank after it"
            raise InputError(
                f"{where}, field {field}: {blank}; write {{{quote_input(': '.join(joined.groups()))}}}"
            )
    is_number = declarations.INTEGER_PATTERN.match
    sides = [int(key) if is_number(key) else key for key in entries]
    arguments.check_distinct_sides(sides, f"{where}, field {field}")
    return dict(zip(sides, entries.values(), strict=True))


def _locate_tables(entry: Any, folder: Path) -> Any:
    """An entry of a field, or several ones, with the files of tables relative to the folder."""
    if isinstance(entry, list):
        return [_locate_tables(value, folder) for value in entry]
    if isinstance(entry, dict):
        return {
            key: str(folder / value) if key == "table" else _locate_tables(value, folder)
            for key, value in entry.items()
        }
    return entry
