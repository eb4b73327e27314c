"""Problems from the fields of a file or the arguments of Python: the data are read once, and checked once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Sized
from dataclasses import replace
from numbers import Number
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array
from unilateral.errors import InputError, quote_input
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import ZERO, Expression
from unilateral.formulas.formula import compile_numpy, parse_number
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import MAX_VERTICES, TOO_MANY_VERTICES, Polygon
from unilateral.problems import arguments
from unilateral.problems.data_checks import check_data, constrained_vertices
from unilateral.problems.fields import linear_fields
from unilateral.problems.functions import Function, evaluate_function
from unilateral.problems.nodal import NodalTrace, side_nodes
from unilateral.problems.polygon_file import read_polygon
from unilateral.problems.problem import Problem, as_formula
from unilateral.problems.reading import (
    Given,
    exact_side_ends,
    exact_vertices,
    fit_to_side,
    read_data,
    read_sides,
    read_source,
)
from unilateral.problems.side_models import SideData

GivenOnSides = Given | Sequence[Given] | Mapping[Any, Given]
"""What a user gives for all sides, for each, or by their numbers and names."""
MAX_COEFFICIENT = 1e30
"""The largest k and c; the smallest is 1 over this."""
FUNCTION_ACCURACY = 2.0**-26
"""Functions keep half of the digits: at a vertex they may differ by this part of the larger number there."""
FUNCTION_ROUNDING = 64 * EPS
"""They may also differ by this part of the largest number on the two sides, of which terms may cancel."""


def make_problem(
    polygon: Polygon | Mesh | ArrayLike | str | PathLike[str],
    f: Given,
    g: GivenOnSides,
    *,
    free_sides: Sequence[int | str] | None = (),
    name: str = "problem",
    k: str | float = 1,
    c: str | float = 1,
    q: GivenOnSides = 0,
    u: Mapping[Any, Given] | None = None,
) -> Problem:
    """The problem with the arguments of `api.Problem`. Raises InputError with the argument."""
    if not isinstance(name, str) or not name:
        raise InputError(f"name is {quote_input(repr(name))}; it has to be a text")
    if not isinstance(u, Mapping | None):
        raise InputError(
            f"{name}, field u: it is {quote_input(repr(u))}; it has to be a dict such as {{3: 0}}"
        )
    mesh = polygon if isinstance(polygon, Mesh) else None
    if isinstance(polygon, str | PathLike):
        domain = read_polygon(polygon, name, f"{name}, field polygon", {})
    elif mesh is None:
        vertices = arguments.as_vertices(polygon, f"{name}, field polygon")
        check_vertex_count(vertices, name)
        domain = make_polygon(vertices, name, name, getattr(polygon, "side_names", {}))
    else:
        domain = mesh.polygon
    return build_problem(
        name, domain, exact_vertices(domain), f, g,
        free_sides=free_sides, k=k, c=c, q=q, u=(u or {}).items(), mesh=mesh, where=name,
    )  # fmt: skip


def check_vertex_count(vertices: Sized, where: str) -> None:
    """Raises InputError for a polygon with too many vertices, before they are read."""
    if len(vertices) > MAX_VERTICES:
        raise InputError(f"{where}, field polygon: {TOO_MANY_VERTICES.format(len(vertices))}")


def make_polygon(vertices: Array, name: str, where: str, side_names: Mapping[str, Any]) -> Polygon:
    """The polygon with these vertices (n, 2). Raises InputError, beginning with `where`."""
    try:
        return Polygon(vertices + 0.0, name, side_names)  # no -0.0
    except InputError as error:
        raise InputError(f"{where}, field polygon: {error}") from None


def build_problem(
    name: str,
    polygon: Polygon,
    exact_vertices: Sequence[list[Expression]],
    f: Given,
    g: GivenOnSides,
    *,
    free_sides: object,
    k: object,
    c: object,
    q: GivenOnSides,
    u: Iterable[tuple[object, Given]],
    where: str,
    title: str = "",
    mesh: Mesh | None = None,
) -> Problem:
    """The problem with these data, read and checked; functions wait for a mesh if none is given.

    `exact_vertices` are the exact coordinates of the polygon's vertices. `u` has each clamped side with what
    u is there. Raises InputError, beginning with `where` and the field.
    """
    ends = exact_side_ends(exact_vertices)
    # the equation and the kinds of sides
    conductivity = _read_coefficient(k, f"{where}, field k")
    reaction = _read_coefficient(c, f"{where}, field c", allow_zero=True)
    free = tuple(sorted(arguments.as_side_numbers(free_sides, polygon, f"{where}, field free_sides")))
    clamped = arguments.expand_sides(u, polygon, f"{where}, field u")
    for side in {*free} & {*clamped}:
        label = polygon.label_side(side)
        raise InputError(
            f"{where}, field free_sides: side {label} is clamped; remove it from free_sides or from u"
        )
    if not clamped and reaction == ZERO:
        raise InputError(
            f"{where}, field c: it is 0 and no side is clamped, so that u is not unique; clamp a side in the "
            "field u, or take a c above 0"
        )
    # the data, on clamped sides u in the place of g
    source = read_source(f, mesh, f"{where}, field f")
    obstacles = read_sides("g", g, polygon, ends, free, clamped, mesh, f"{where}, field g")
    fluxes = read_sides("q", q, polygon, ends, free, clamped, mesh, f"{where}, field q")
    for side, value in clamped.items():
        place = f"{where}, field u[{side}]"
        obstacles[side] = fit_to_side("u", read_data("u", value, place), side, ends[side], mesh, place)
    problem = Problem(
        name=name,
        polygon=polygon,
        f=source,
        g=tuple(obstacles),
        free_sides=free,
        k=conductivity,
        c=reaction,
        q=tuple(fluxes),
        mesh=mesh,
        title=title,
        clamped_sides=tuple(sorted(clamped)),
    )
    return _check_on_mesh(problem, mesh, where)


def replace_data(
    problem: Problem, mesh: Mesh, f: Given = None, g: GivenOnSides = None, q: GivenOnSides = None
) -> Problem:
    """The problem on a mesh, with another f, g or q; what is None stays.

    A case becomes a problem whose solution is not known. Raises InputError as `build_problem`.
    """
    name = problem.name
    ends = exact_side_ends(exact_vertices(problem.polygon))
    free = problem.free_sides
    clamped = problem.clamped_sides
    changed: dict[str, Any] = {"exact": None, "title": ""} if problem.exact else {}
    if f is not None:
        changed["f"] = read_source(f, mesh, f"{name}, field f")
    if g is not None:
        obstacles = read_sides("g", g, problem.polygon, ends, free, clamped, mesh, f"{name}, field g")
        for side in clamped:
            obstacles[side] = problem.g[side]
        changed["g"] = tuple(obstacles)
    if q is not None:
        changed["q"] = tuple(
            read_sides("q", q, problem.polygon, ends, free, clamped, mesh, f"{name}, field q")
        )
    new = replace(problem, **changed)
    if linear_fields(new):  # values at nodes belong to a mesh
        new = replace(new, mesh=mesh)
    if q is None and not new.has_functions:
        # q is the same, and so is what was computed of it
        vars(new)["enclosed_flux"] = problem.enclosed_flux
    return _check_on_mesh(new, mesh, name)


def put_on_mesh(problem: Problem, mesh: Mesh) -> Problem:
    """The problem with the values of its functions at the nodes of the mesh; itself if it has no functions.

    It is then guaranteed for the functions that are linear between these values. Raises InputError for a
    function that fails or is not finite at a node, and where g or u jumps at a vertex.
    """
    return _check_on_mesh(problem, mesh, problem.name) if problem.has_functions else problem


def _check_on_mesh(problem: Problem, mesh: Mesh | None, where: str) -> Problem:
    """The problem with its functions at the nodes of the mesh, checked. Without a mesh functions stay."""
    if problem.has_functions and mesh is not None:
        problem = _evaluate_functions(problem, mesh)
    if problem.has_functions:
        return problem
    check_data(problem, where)
    return problem


def _evaluate_functions(problem: Problem, mesh: Mesh) -> Problem:
    """The problem with the values of its functions at the nodes; g, and u, are joined at the vertices."""
    f = problem.f
    if callable(f):
        f = evaluate_function(f, mesh.points, f"{problem.name}, field f")
    g = [*problem.g]
    for side, obstacle in enumerate(g):
        if callable(obstacle):
            field = "u" if side in problem.clamped_sides else "g"
            g[side] = _evaluate_on_side(obstacle, mesh, side, f"{problem.name}, field {field}[{side}]")
    q = [*problem.q]
    for side, flux in enumerate(q):
        if callable(flux):
            q[side] = _evaluate_on_side(flux, mesh, side, f"{problem.name}, field q[{side}]")
    for vertex in constrained_vertices(problem):
        _join_at_vertex(problem, g, vertex)
    return replace(problem, f=f, g=tuple(g), q=tuple(q), mesh=mesh)


def _evaluate_on_side(function: Function, mesh: Mesh, side: int, where: str) -> NodalTrace:
    """The values of a function at the nodes of a side."""
    nodes, t = side_nodes(mesh, side)
    return NodalTrace(t, evaluate_function(function, mesh.points[nodes], where))


def _join_at_vertex(problem: Problem, g: Sequence[SideData | Function], vertex: int) -> None:
    """Gives functions the value of the other side at a vertex, if they differ there by rounding only.

    g is what is given on the sides, with the values of functions, which are changed. Larger differences stay,
    for `check_data` to refuse.
    """
    before = (vertex - 1) % problem.polygon.n_sides
    after = vertex
    if not (callable(problem.g[before]) or callable(problem.g[after])):
        return
    x, y = problem.polygon.vertices[vertex]
    values = []
    sizes = []
    for side, index in ((before, -1), (after, 0)):
        data = g[side]
        if isinstance(data, NodalTrace):
            at_vertex = data.values[index]
            size = np.abs(data.values).max()
        else:
            at_vertex = compile_numpy([as_formula(data)], "xy")(x, y)[0].item()
            size = abs(at_vertex)
        values.append(at_vertex)
        sizes.append(size)
    # By half of the digits of the value at the vertex, or the rounding of terms that cancel there
    allowed = FUNCTION_ACCURACY * max(map(abs, values)) + FUNCTION_ROUNDING * max(sizes)
    if abs(values[1] - values[0]) > allowed:
        return
    start = g[after]
    end = g[before]
    if callable(problem.g[after]) and isinstance(start, NodalTrace):
        start.values[0] = values[0]
    elif callable(problem.g[before]) and isinstance(end, NodalTrace):
        end.values[-1] = values[1]


def _read_coefficient(value: object, where: str, allow_zero: bool = False) -> Expression:
    """An exact number that is positive, or 0 if that is allowed, and of a size that suits the data."""
    value = arguments.as_file_number(value, where)
    if isinstance(value, bool) or not isinstance(value, str | Number):
        raise InputError(
            f"{where}: it is {quote_input(repr(value))}; it has to be an exact number, such as 3, 0.05 or 1/3"
        )
    coefficient = parse_number(value, where)
    if allow_zero and coefficient == ZERO:
        return coefficient
    if not 1 / MAX_COEFFICIENT <= as_float(coefficient) <= MAX_COEFFICIENT:
        raise InputError(
            f"{where}: it is {quote_input(value)}; it has to be a positive number, "
            f"between {1 / MAX_COEFFICIENT:g} and {MAX_COEFFICIENT:g}" + ", or 0" * allow_zero
        )
    return coefficient
