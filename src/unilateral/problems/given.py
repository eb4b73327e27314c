"""Problems as programs give them: by name, or with f, g and q as formulas, functions or arrays at nodes."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Number
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array
from unilateral.errors import InputError, shown
from unilateral.formulas.expression import ZERO, Expression
from unilateral.formulas.formula import compile_numpy
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments, nodal, problem_file
from unilateral.problems.data_checks import check, check_vertices
from unilateral.problems.nodal import Nodal, NodalTrace, NodalTraces
from unilateral.problems.problem import Problem, contact_sides
from unilateral.problems.sampled import Function, Sampled, check_arguments
from unilateral.problems.side_fields import ends_of, on_sides, plain, trace
from unilateral.system.files import path_of
from unilateral.system.optional import require

AnyProblem = Problem | Sampled

Coefficient = str | float
"""A number, or one that is written exactly, such as "1/3"."""
Given = str | float | Function | Array | None
"""f, g or q, everywhere or on a side: a formula, a function, an array at nodes, or nothing."""
Read = Expression | Function | NodalTrace


@dataclass(frozen=True)
class FormulaFunction:
    """A formula as a function of arrays, in a problem that has functions, too."""

    formula: Expression

    def __call__(self, x: Array, y: Array) -> Array:
        return self._compiled(x, y)

    @cached_property
    def _compiled(self) -> Function:
        compiled = compile_numpy([self.formula], "xy")
        return lambda x, y: compiled(x, y)[0]


def case(
    name: str | os.PathLike[str],
    polygon: str | Polygon | None = None,
    side: int = 0,
    free_sides: Sequence[int] | None = (),
) -> Problem:
    """A case of the catalogue by its name, or of a YAML file: a problem whose solution is known.

    It is put on that side of the polygon, which is by default the first of those that it is for. A polygon is
    given by its name, or by a YAML file that has it in the field `polygon`. On `free_sides`, which must carry
    no contact, there are no multipliers. Raises InputError, among others for a case that is not certified.

    >>> import unilateral as ul
    >>> ul.case("natural").polygon.name
    'square'
    """
    require("cases with known solutions need", "sympy")
    from unilateral.problems import (
        case as cases,  # sympy, on which they rest, takes longer than a small problem
    )
    from unilateral.problems.case_certificate import certify, with_free_sides

    given = str(path_of(name, "natural"))
    if polygon is None:
        polygons = cases.declared(given)[0]["polygons"]
        polygon = "square" if polygons == "any" else polygons[0]
    on = polygon if isinstance(polygon, Polygon) else str(path_of(polygon, "square"))
    domain = problem_file.polygon_of(on) if isinstance(on, str) else on
    found = cases.load(given, domain, arguments.side(side, domain.n_sides, "side"))
    certify(found)
    free = arguments.sides(free_sides, domain.n_sides, "free sides")
    return with_free_sides(found.problem, free) if free else found.problem


def load(path: str | os.PathLike[str]) -> Problem:
    """What a YAML file declares: a problem, or a case. Raises InputError with the file and the field.

    >>> import pathlib, tempfile
    >>> import unilateral as ul
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "own.yaml")
    ...     _ = file.write_text("{polygon: [[0, 0], [1, 0], [0, 1]], f: x - 1, g: 0}")
    ...     ul.load(file)
    Problem 'own'; polygon = 3 sides, area 0.5, f = x - 1, g = 0
    """
    name = str(path_of(path, "problem.yaml"))
    return problem_file.load(name) if problem_file.is_declared_in(name) else case(name)


def problem_of(given: object) -> AnyProblem | None:
    """The problem that is given, or that of a name; None for what is neither."""
    if isinstance(given, str | os.PathLike):
        return load(given)
    return given if isinstance(given, Problem | Sampled) else None


def mesh_of(problem: AnyProblem) -> Mesh | None:
    """The mesh that a problem was made of."""
    return problem.nodal.mesh


def bare(
    domain: Mesh | Polygon | ArrayLike,
    free_sides: Sequence[int] | None,
    k: object,
    c: object,
    name: str,
    u: Mapping[int, Given] | None = None,
) -> Problem:
    """The problem with f = g = u = q = 0 on a polygon, or on that of a mesh, which is then part of it.

    The keys of `u` are the clamped sides. Raises InputError as for a problem file.
    """
    if not isinstance(name, str) or not name:
        raise InputError(f"name is {shown(repr(name))}; it has to be a text")
    if not isinstance(u, Mapping | None):
        raise InputError(f"{name}, field u: it is {shown(repr(u))}; it has to be a dict such as {{3: 0}}")
    mesh = domain if isinstance(domain, Mesh) else None
    polygon = domain.polygon if isinstance(domain, Mesh) else domain
    vertices = arguments.vertices(polygon, f"{name}, field polygon")
    fields = {
        "polygon": vertices.tolist(),
        "free_sides": arguments.sides(free_sides, len(vertices), f"{name}, field free_sides"),
        "k": arguments.number(k, f"{name}, field k"),
        "c": arguments.number(c, f"{name}, field c"),
        "u": {str(side): 0 for side in arguments.sides(u, len(vertices), f"{name}, field u")},
    }
    found = problem_file.made(fields | {"f": 0, "g": 0}, name, name)
    return replace(found, polygon=mesh.polygon, nodal=Nodal(mesh)) if mesh else found


def to_be_given(of: AnyProblem) -> Problem | Sampled:
    """The problem or, for a case, the one with f = g = 0 on its polygon, with its free and clamped sides."""
    return replace(of, exact=None, title="") if isinstance(of, Problem) and of.exact else of


def with_data(
    of: Problem | Sampled,
    f: Given = None,
    g: Given | Sequence[Given] = None,
    q: Given | Sequence[Given] = None,
    mesh: Mesh | None = None,
    u: Mapping[int, Given] | None = None,
) -> Problem | Sampled:
    """The problem with another f, g, q or u, as they are given; what is None stays.

    Arrays (n,) belong to the nodes of the `mesh`, by default that of the problem. Raises InputError as for a
    problem file, and for an array that does not fit the mesh.
    """
    mesh, name = mesh or of.nodal.mesh, of.name
    before = of.nodal.f if of.nodal.f is not None else _read(of.f)
    of_f = before if f is None else _read_f(f, mesh, f"{name}, field f")
    of_g = [*map(_read, of.g)] if g is None else _read_sides(of, g, mesh, "g")
    traces = of.nodal.g if g is None else _traces(of_g) | _on(of.clamped_sides, of.nodal.g)
    for side, given in (u or {}).items():
        of_g[side] = _read_trace(of, given, mesh, side)
        traces = {i: trace for i, trace in traces.items() if i != side} | _on([side], _traces(of_g))
    of_q = [*map(_read, of.q)] if q is None else _read_sides(of, q, mesh, "q")
    arrays = Nodal(
        mesh,
        of_f if isinstance(of_f, np.ndarray) else None,
        traces,
        of.nodal.q if q is None else _traces(of_q),
    )
    kept = ("name", "polygon", "free_sides", "units", "clamped_sides")
    fields: dict[str, Any] = {field: getattr(of, field) for field in kept} | {"nodal": arrays}
    sampled = any(callable(each) for each in (of_f, *of_g, *of_q))
    held: Callable[[Any], Any] = _function if sampled else _formula
    fields |= {"f": held(of_f), "g": tuple(map(held, of_g)), "q": tuple(map(held, of_q))}
    if sampled:
        check_vertices(functions := Sampled(**fields))
        return functions
    found = Problem(title=of.title, **fields)
    if isinstance(of, Problem) and q is None:
        vars(found)["enclosed_flux"] = of.enclosed_flux
    problem_file.check_roots(found, name)
    check(found, name)
    return found


def _read_f(given: Given, mesh: Mesh | None, where: str) -> Read | Array:
    given = _checked(given, where)
    if nodal.is_array(given):
        return nodal.at_nodes(mesh, given, where)
    return given if callable(given) else problem_file.formula(given, where)


def _read_sides(
    of: Problem | Sampled, given: Given | Sequence[Given], mesh: Mesh | None, field: str
) -> list[Read]:
    """(n sides,) g or q on each side, 0 on those that have none; one is for all sides."""
    where, kept = f"{of.name}, field {field}", of.clamped_sides if field == "g" else ()
    listed = [*given] if isinstance(given, Sequence) and not isinstance(given, str | bytes) else None
    places = [where] if listed is None else [f"{where}[{side}]" for side in range(len(listed))]
    read = [*map(_checked, [given] if listed is None else listed, places)]
    # The same checks of sides as for formulas, with a number in place of the others.
    numbers = [1 if callable(each) or nodal.is_array(each) else each for each in read]
    on = ends_of(of.polygon), of.free_sides, of.clamped_sides
    found: list[Read] = [*on_sides(field, numbers[0] if listed is None else numbers, *on, where)]
    for side in kept:
        found[side] = _read(of.g[side])
    for side in of.free_sides if field == "q" else contact_sides(of.polygon, of.free_sides, kept):
        each, place = (read[0], where) if listed is None else (read[side], places[side])
        if nodal.is_array(each):
            found[side] = nodal.trace(mesh, each, side, place)
        elif callable(each):
            found[side] = each
    return found


def _read_trace(of: Problem | Sampled, given: Given, mesh: Mesh | None, side: int) -> Read:
    """What u is on a clamped side; 0 if it is None."""
    where = f"{of.name}, field u[{side}]"
    given = _checked(given, where)
    if nodal.is_array(given):
        return nodal.trace(mesh, given, side, where)
    if callable(given):
        return given
    return trace(plain(given, where, "u"), ends_of(of.polygon)[side], side, where)


def _on(sides: Sequence[int], traces: NodalTraces) -> dict[int, NodalTrace]:
    """The traces on some sides."""
    return {side: trace for side, trace in traces.items() if side in sides}


def _checked(given: Any, where: str) -> Given:
    """What is given, numbers as in a file. Raises InputError for what is no formula, function or array."""
    if callable(given):
        check_arguments(given, where)
        return given  # type: ignore[no-any-return]
    given = arguments.number(given, where)
    if given is None or isinstance(given, str | Number) or nodal.is_array(given):
        return given  # type: ignore[return-value]
    raise InputError(
        f"{where}: it is {shown(repr(given))}; it has to be a formula, a function or an array of values "
        "at nodes"
    )


def _traces(of: Sequence[Read]) -> dict[int, NodalTrace]:
    return {side: each for side, each in enumerate(of) if isinstance(each, NodalTrace)}


def _read(of: Expression | Function) -> Read:
    """What a problem holds as it was given."""
    return of.formula if isinstance(of, FormulaFunction) else of


def _formula(of: Read | Array) -> Expression:
    """The formula, or 0 for an array."""
    return of if isinstance(of, Expression) else ZERO


def _function(of: Read | Array) -> Function:
    return of if callable(of) else FormulaFunction(_formula(of))
