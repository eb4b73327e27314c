"""Reads problems from YAML files, and refuses those that cannot be solved, with the file and the field."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.errors import InputError, shown
from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ZERO, Expression, atoms_in, has_root, variable
from unilateral.formulas.expression import number as exact
from unilateral.formulas.formula import kinks, number, parse, substituted
from unilateral.formulas.grammar import NO_LOG, NO_ROOT
from unilateral.geometry.polygon import MAX_VERTICES, TOO_MANY, Polygon, named, names
from unilateral.problems import catalogue
from unilateral.problems.problem import Problem, curve
from unilateral.problems.sampled import Sampled, check_vertex
from unilateral.problems.scaled import scaled_polygon
from unilateral.problems.units import Units
from unilateral.system import declarations

Ends = tuple[list[Expression], list[Expression]]
FIELDS = {"polygon", "f", "g", "free_sides"}
SMALLEST, LARGEST = 1e-140, 1e140
"""The limits of |f|, |g| and |q|, so that squares of data are normal numbers.

For the squares of errors see `flux_residuals.underflow`.
"""
POWER = 2
"""Where the root of the polygon's area is above 1, in units of (k/c)^{1/2}, data are multiplied by this
power of it.
"""
ALMOST_ZERO = 1e-320
"""Interval arithmetic makes at most this of 0, in the user's units."""
ROUND_OFF = 1e-12
NOTHING = ("none", "null", "nil")
"""What people write for no formula, in small or large letters."""
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
            f"{name} has no fields; a problem has polygon, f and g; a case title, polygons, u, ..."
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
    fields = {"u": dict.fromkeys(clamped, 0), "c": 0 if str(declaration.get("c")) == "0" else 1}
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
    units = Units(
        _coefficient(declaration.get("k", 1), f"{where}, field k"),
        _coefficient(declaration.get("c", 1), f"{where}, field c", or_0=True),
    )
    free = _free_sides(declaration, polygon, where)
    clamped = _clamped_sides(declaration.get("u", {}), polygon, free, f"{where}, field u")
    if not (clamped or units.reaction):
        raise InputError(
            f"{where}, field c: it is 0 and no side is clamped, so that u is not unique; clamp a side in the "
            "field u, or take a c above 0"
        )
    f = formula(declaration["f"], f"{where}, field f")
    ends = [*zip(corners, corners[1:] + corners[:1], strict=True)]
    g = _obstacles(declaration["g"], ends, free, [*clamped], f"{where}, field g")
    for side, text in clamped.items():
        g[side] = trace(text, ends[side], side, f"{where}, field u[{side}]")
    q = _fluxes(declaration.get("q"), polygon.n_sides, free, f"{where}, field q")
    title = declaration.get("title", "")
    problem = Problem(name, polygon, f, tuple(g), free, units, q, title=title, clamped_sides=tuple(clamped))
    try:
        scaled_polygon(problem)
    except InputError as error:
        raise InputError(f"{where}, fields k and c: scaled by (c/k)^(1/2), {error}") from None
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


def _free_sides(declaration: dict[str, Any], polygon: Polygon, name: str) -> tuple[int, ...]:
    free = tuple(sorted(declaration.get("free_sides", [])))
    where = f"{name}, field free_sides"
    if free and free[-1] >= polygon.n_sides:
        raise InputError(f"{where}: the polygon has the sides 0 to {polygon.n_sides - 1}, not {free[-1]}")
    twice = [a for a, b in pairwise(free) if a == b]
    if twice:
        raise InputError(f"{where}: side {twice[0]} is given twice; give it once")
    return free


def _clamped_sides(
    given: dict[str, Any], polygon: Polygon, free: tuple[int, ...], where: str
) -> dict[int, Any]:
    """What u is on each clamped side, in their order."""
    sides = {int(side): text for side, text in given.items()}
    if sides and max(sides) >= polygon.n_sides:
        raise InputError(f"{where}: the polygon has the sides 0 to {polygon.n_sides - 1}, not {max(sides)}")
    both = sorted({*sides} & {*free})
    if both:
        raise InputError(
            f"{where}: side {both[0]} is in free_sides, too; on a side either u is given or its flux"
        )
    return dict(sorted(sides.items()))


def _obstacles(
    given: Any, ends: list[Ends], free: tuple[int, ...], clamped: Sequence[int], where: str
) -> list[Expression]:
    """g on every side as a formula in x, y; 0 on sides without contact."""
    _check_count(given, len(ends), where)
    formulas = []
    for side, of_side in enumerate(ends):
        text, place = (given[side], f"{where}[{side}]") if isinstance(given, list) else (given, where)
        if text is None and side not in [*free, *clamped]:
            raise InputError(
                f"{place}: there is no formula, and side {side} is not free; "
                "write one, or name the side in free_sides or in u"
            )
        if text is not None and isinstance(given, list) and side in clamped:
            raise InputError(f"{place}: side {side} is clamped; write null, or take it out of u")
        instead = "in a list write null for a side that is named in free_sides"
        carries = side not in [*free, *clamped]
        formula = trace(text, of_side, side, place) if carries else _plain(text, place, instead)
        formulas.append(formula if carries else ZERO)
    return formulas


def trace(text: object, ends: Ends, side: int, where: str) -> Expression:
    """g or u on a side between two `ends` as a formula in x, y; 0 if there is none; see `made`."""
    formula = _plain(text, where, "in a list write null for a side that is named in free_sides")
    if not atoms_in(formula, "pos"):
        return formula
    (x0, y0), (x1, y1) = ends
    t = variable("t")
    on_side = {"x": x0 + t * (x1 - x0), "y": y0 + t * (y1 - y0)}
    along = substituted(formula, on_side, f"{where}, on side {side}")
    try:
        powers = [k for t, k in kinks(along, "t") if 0 <= t <= 1]
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if any(k < 1 for k in powers):
        raise InputError(f"{where}: a power of pos below 1 on side {side}; it must be Lipschitz")
    return formula


def ends_of(polygon: Polygon) -> list[Ends]:
    """The exact coordinates of the two ends of every side."""
    vertices = [[exact(Fraction(repr(x))) for x in vertex] for vertex in polygon.vertices.tolist()]
    return [*zip(vertices, vertices[1:] + vertices[:1], strict=True)]


def _check_count(given: Any, n: int, where: str) -> None:
    """Raises InputError for a list that does not have one formula per side."""
    if isinstance(given, list) and len(given) != n:
        raise InputError(f"{where}: {len(given)} formulas for {n} sides; give one for all, or one per side")


def _fluxes(given: Any, n: int, free: tuple[int, ...], where: str) -> tuple[Expression, ...]:
    """q on every side as a formula in x, y; 0 where there is none. One formula is for all free sides."""
    _check_count(given, n, where)
    if not isinstance(given, list):
        formula = _flux(given, where)
        if formula.rational != 0 and not free:
            raise InputError(f"{where}: no side is free; name those with a given flux in free_sides")
        return tuple(formula if side in free else ZERO for side in range(n))
    held = [side for side, text in enumerate(given) if text is not None and side not in free]
    if held:
        raise InputError(
            f"{where}[{held[0]}]: side {held[0]} is not free; write null, or name it in free_sides"
        )
    return tuple(_flux(text, f"{where}[{side}]") for side, text in enumerate(given))


def _flux(text: object, where: str) -> Expression:
    """A formula in x, y that may jump; 0 where there is none."""
    return _plain(text, where, "write 0 where there is none, or in a list null")


def _plain(text: object, where: str, instead: str) -> Expression:
    """A formula in x, y without logarithms and roots, 0 for None.

    Raises InputError for a word that says that there is no formula; `instead` is what to write for it.
    """
    if isinstance(text, str) and text.strip().lower() in NOTHING:
        raise InputError(f"{where}: '{text}' is no formula; {instead}")
    formula = parse(0 if text is None else text, ("x", "y"), where)
    if atoms_in(formula, "log"):
        raise InputError(f"{where}: {NO_LOG}")
    if has_root(formula):
        raise InputError(f"{where}: {NO_ROOT}")
    return formula


def on_sides(field: str, given: object, of: Problem | Sampled, where: str) -> Sequence[Expression]:
    """The field g or q on every side as a formula in x, y, 0 on sides without one; see `made`."""
    if field == "q":
        return _fluxes(given, of.polygon.n_sides, of.free_sides, where)
    return _obstacles(given, ends_of(of.polygon), of.free_sides, of.clamped_sides, where)


def formula(text: object, where: str) -> Expression:
    """f as a formula in x, y whose kinks can be found; see `made`."""
    f = _plain(text, where, "write 0 where there is none")
    for power in atoms_in(f, "pos"):
        try:
            curve(power.args[0])
        except ValueError as error:
            raise InputError(f"{where}: the argument of {power} {error}") from None
    return f


def check(problem: Problem, name: str) -> None:
    """Raises InputError unless f, g, u and q are finite and fit together at each vertex, see `check_vertex`.

    A g that jumps at a vertex is the trace of no u in H^1. The sizes of f, g and q are looked at in the units
    in which the problem is solved.
    """
    units = problem.units
    of_f, unit = max(map(abs, problem.range_of_f)), math.sqrt(problem.polygon.area) / units.length
    _check_size(of_f, units.load, unit, f"{name}, field f", "in the polygon")
    n, obstacle = problem.polygon.n_sides, problem.enclosed_obstacle
    constrained = [side for side in range(n) if side not in problem.free_sides]
    largest = 0.0
    for side in constrained:
        largest = max(largest, *map(abs, obstacle.range(side)))
        field = "u" if side in problem.clamped_sides else "g"
        _check_size(largest, units.value, unit, f"{name}, field {field}", f"on side {side}", least=False)
    _check_size(largest, units.value, unit, f"{name}, field g", "on all sides")
    for side in problem.flux_sides:
        of_q = max(map(abs, problem.enclosed_flux.range(side)))
        _check_size(of_q, units.flux, unit, f"{name}, field q", f"on side {side}")
    for side, before in ((side, (side - 1) % n) for side in constrained):
        if before in constrained:
            end, start, doubt = obstacle.at_vertex(side)
            at = (before, end), (side, start), ROUND_OFF * largest + doubt
            check_vertex(name, problem.polygon, problem.clamped_sides, *at)


def _check_size(given: float, one: float, unit: float, where: str, place: str, least: bool = True) -> None:
    """Raises InputError if |f|, |g| or |q|, `given`, is too large or too small.

    `one` is what is 1 in (1.1)-(1.2), where `unit` is the root of the polygon's area.
    """
    size = given / one
    if not np.isfinite(size):
        raise InputError(f"{where}: it is not finite {place}, or no bound can be found")
    smallest, largest = SMALLEST / min(unit, 1.0), LARGEST / max(unit, 1.0) ** POWER
    if size > largest or (given > ALMOST_ZERO and size < smallest and least):
        of_polygon = f" on a polygon with the area {unit**2:.3g}" if unit != 1 else ""
        raise InputError(
            f"{where}: it is as large as {size:.3g} {place}, and squares of errors{of_polygon} leave the "
            f"range of double precision; scale the data to a size between {smallest:.3g} and {largest:.3g}"
        )
