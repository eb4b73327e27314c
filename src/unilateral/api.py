"""What users call, as `import unilateral as ul`.

>>> import unilateral as ul
>>> problem = ul.Problem([(0, 0), (1, 0), (1, 1), (0, 1)], f="-1", g="-x*y/2")
>>> s = ul.solve(problem, h=1 / 16, H=1 / 8)
>>> s.u.shape, s.multiplier.shape, s.converged
((289,), (32,), True)
>>> s.bounds.u < 0.1
True
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from unilateral.accuracy.goal import NORMS, Goal
from unilateral.accuracy.level import Level
from unilateral.accuracy.search import WITHDRAWN, Search, search
from unilateral.accuracy.watch import Watch
from unilateral.discrete.choice import cheapest, check_size, levels_for
from unilateral.errors import InputError, IterationWarning, SolutionWarning, shown
from unilateral.formulas.decimals import up
from unilateral.formulas.formula import parse, real
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import read_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import natural_kind, structured
from unilateral.problems import arguments, problem_file
from unilateral.problems import problem as problems
from unilateral.problems.data import is_case
from unilateral.problems.sampled import Function, OfFormula, Sampled, check_arguments, check_vertices
from unilateral.problems.scaled import scaled
from unilateral.solution.certificate import SIZE, relative
from unilateral.solution.solution import Solution, not_converged, not_unique
from unilateral.solvers.stop import Stop
from unilateral.system.files import path_of

if TYPE_CHECKING:
    from unilateral.problems.case import Case

    AnyProblem = Case | problems.Problem | Sampled

Formula = str | float
Coefficient = str | float
"""A number, or one that is written exactly, such as "1/3"."""
Size = float | str
"""A number, or one that is written as a fraction, such as "1/64"."""
Given = Formula | Function | None
KINDS = {"structured": structured, "unstructured": meshes.unstructured}
"""The kinds of meshes that are made for a polygon and a size h."""


def case(
    name: str | os.PathLike[str],
    polygon: str | Polygon | None = None,
    side: int = 0,
    free_sides: Sequence[int] | None = (),
) -> Case:
    """A case of the catalogue by its name, or of a YAML file: a problem whose solution is known.

    It is put on that side of the polygon, which is by default the first of those that it is for. A polygon is
    given by its name, or by a YAML file that has it in the field `polygon`. On `free_sides`, which must carry
    no contact, there are no multipliers. Raises InputError, among others for a case that is not certified.

    >>> import unilateral as ul
    >>> ul.case("natural").polygon.name
    'square'
    """
    from unilateral.problems import (
        case as cases,  # sympy, on which they rest, takes longer than a small problem
    )
    from unilateral.problems.case_certificate import certify, with_free_sides

    given = str(path_of(name, "natural"))
    if polygon is None:
        polygons = cases.declared(given)[0]["polygons"]
        polygon = "square" if polygons == "any" else polygons[0]
    domain = (
        polygon if isinstance(polygon, Polygon) else problem_file.polygon_of(str(path_of(polygon, "square")))
    )
    found = cases.load(given, domain, arguments.side(side, "side"))
    certify(found)
    free = arguments.sides(() if free_sides is None else free_sides, "free_sides")
    return with_free_sides(found, free) if free else found


def load(path: str | os.PathLike[str]) -> Case | problems.Problem:
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


def Problem(
    polygon: Polygon | ArrayLike,
    f: Formula | Function,
    g: Given | Sequence[Given],
    free_sides: Sequence[int] | None = (),
    name: str = "problem",
    *,
    k: Coefficient = 1,
    c: Coefficient = 1,
    q: Given | Sequence[Given] = None,
) -> problems.Problem | Sampled:
    """A problem of one's own: -k lap u + c u = f, with an obstacle g on the sides that are not free.

    On these u >= g, k du/dn >= 0 and (u - g) k du/dn = 0; for k = c = 1 this is (1.1)-(1.2). On the free
    sides k du/dn = q. The errors are measured in the norm (k |v|_1^2 + c ||v||_0^2)^{1/2} and its dual.

    `polygon` has the vertices (n, 2), anticlockwise; side i runs from vertex i to the next. f, g for all
    sides or one per side (None on a free one), and q for all free sides or one per side (None on the others)
    are formulas in x and y, as in a problem file, or functions of two arrays. Where one of them is a function
    nothing can be guaranteed: a solution then has no bounds, and no accuracy can be asked for. A function
    that takes one point at a time has to be given as `np.vectorize(function, otypes=[float])`. Raises
    InputError as for a problem file.

    >>> import unilateral as ul
    >>> ul.Problem([(0, 0), (1, 0), (0, 1)], f="x - 1", g=[0, None, 0], free_sides=[1]).free_sides
    (1,)
    """
    if not isinstance(name, str) or not name:
        raise InputError(f"name is {shown(repr(name))}; it has to be a text")
    vertices = arguments.vertices(polygon, f"{name}, field polygon")
    free = arguments.sides(() if free_sides is None else free_sides, f"{name}, field free_sides")
    f, k, c = (
        arguments.number(of, f"{name}, field {each}") for each, of in zip("fkc", (f, k, c), strict=True)
    )
    g, q = (
        _each(of, partial(arguments.number, where=f"{name}, field {each}"))
        for each, of in (("g", g), ("q", 0 if q is None else q))
    )
    common = {"polygon": vertices.tolist(), "free_sides": free, "k": k, "c": c}
    if not any(callable(each) for given in (f, g, q) for each in _listed(given)):
        return problem_file.made(common | {"f": f, "g": g, "q": q}, name, name)
    # The same checks of shapes and sides as for formulas, with numbers in place of the functions.
    numbers = {
        "g": _each(g, lambda each: None if each is None else 0),
        "q": _each(q, lambda each: 1 if callable(each) else each),
    }
    checked = problem_file.made(common | {"f": 0} | numbers, name, name)
    of_f, polygon = _function(f, f"{name}, field f"), Polygon(vertices, name)
    of_g, of_q = (
        [_function(each, f"{name}, field {field}[{i}]") for i, each in enumerate(_listed(given))]
        for field, given in (("g", g), ("q", q))
    )
    on_sides = (tuple(each * (polygon.n_sides // len(each))) for each in (of_g, of_q))
    known = checked.free_sides, checked.units
    found = Sampled(name, polygon, of_f, next(on_sides), *known, next(on_sides), checked.declaration)
    check_vertices(found)
    return found


def _listed(given: Given | Sequence[Given]) -> list[Given]:
    """A list with one for all sides, or one per side."""
    return [given] if isinstance(given, str) or not isinstance(given, Sequence) else list(given)


def _each(given: Given | Sequence[Given], change: Callable[[Given], Given]) -> Given | list[Given]:
    found = [change(each) for each in _listed(given)]
    return found if isinstance(given, Sequence) and not isinstance(given, str) else found[0]


def _function(given: Given, where: str) -> Function:
    if callable(given):
        check_arguments(given, where)
        return given
    return OfFormula(parse(0 if given is None else given, ("x", "y"), where))


def mesh(path: str | os.PathLike[str], polygon: Polygon | None = None) -> Mesh:
    """The triangles in a file of any of meshio's formats; by default their boundary is the polygon.

    >>> import pathlib, tempfile
    >>> import unilateral as ul
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "own.vtu")
    ...     ul.solve("natural", h=1 / 4, H=1 / 2).save(file)
    ...     ul.mesh(file)
    Mesh of 'own': 25 nodes, 32 triangles, h = 0.25
    """
    return read_mesh(path, polygon)


def open(path: str | os.PathLike[str]) -> Solution:
    """The solution in a file that `Solution.save` wrote with the ending .nc.

    u, lambda_H and all else that the solver found are as they were saved, bit for bit. Bounds, true errors
    and forces are computed again when they are asked for, from the problem and the numbers that the file
    holds; so a bound does not rest on what the file says of it. For given sizes they are the same numbers,
    after an accuracy they may differ by rounding. A file holds no functions: without formulas there are no
    bounds, and the `problem` cannot be solved again. Raises InputError for a file that holds no solution, and
    for one that is damaged.

    >>> import tempfile, pathlib
    >>> import unilateral as ul
    >>> s = ul.solve("natural", h=1 / 16, H=1 / 8)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     s.save(pathlib.Path(folder, "s.nc"))
    ...     again = ul.open(pathlib.Path(folder, "s.nc"))
    >>> (again.u == s.u).all(), again.bounds == s.bounds
    (np.True_, True)
    """
    from unilateral.solution.stored import read

    return read(path_of(path, "solution.nc"))


def solve(
    problem: AnyProblem | str | os.PathLike[str],
    h: Size | None = None,
    H: Size | None = None,
    accuracy: Size | None = None,
    *,
    norm: str = "h1",
    mesh: Mesh | str = "",
    stop: Stop | None = None,
    max_unknowns: float | None = None,
    max_seconds: float | None = None,
    max_memory: float | None = None,
    sharp: bool = False,
    absolute: bool = False,
    dry_run: bool = False,
    tell: Callable[[Level], None] | None = None,
    watch: Watch | None = None,
) -> Solution:
    """The solution on given sizes h and H, or up to an accuracy that is then guaranteed.

    The problem is one of `Problem`, `case` and `load`, or the name of a case or of a YAML file.
    h is the longest boundary edge of the mesh, H the longest cell of the multiplier's partition; take h < H,
    such as H = 2h. Large meshes are refined from coarse ones and solved by multigrid.
    `mesh` is "structured", "unstructured" or a mesh of one's own, which takes the place of h.

    An accuracy is that of u in H1, or with `norm` "hm12" of lambda in H^{-1/2}. It is relative to that norm
    of the solution; if it is `absolute`, it is the largest error itself. It is certified by the cheap bound
    on u, or by the `sharp` one; lambda takes the sharp one. The solution's `certified` says whether it was
    reached within `max_unknowns`, `max_seconds` (by default 600) and `max_memory` MB (by default what is
    free). A limit that is given is used up if need be; without one the search ends as soon as the accuracy is
    out of reach. `tell` is called with every level. A `dry_run` ends after the first levels, and the
    solution's `search.plan` says what the accuracy takes. A `watch` may interrupt and see how far a level is.

    Raises BudgetError where a limit leaves no result, and InputError for what does not fit together, or not
    into the memory. Warns by a SolutionWarning where the iteration did not converge, where the
    accuracy was not reached, and where lambda_H may not be unique.

    >>> import unilateral as ul
    >>> ul.solve(ul.case("natural"), accuracy=0.1).certified
    True
    """
    problem = _problem(problem)
    h, H, accuracy = (_number(*each) for each in (("h", h), ("H", H), ("the accuracy", accuracy)))
    if not isinstance(mesh, Mesh) and not (isinstance(mesh, str) and mesh in ("", *KINDS)):
        raise InputError(
            f"the mesh is {shown(repr(mesh))}; it has to be {' or '.join(KINDS)}, or a mesh such as "
            "ul.mesh(path)"
        )
    _check_flags(sharp=sharp, absolute=absolute, dry_run=dry_run)
    if not (tell is None or callable(tell)) or not isinstance(watch, Watch | None):
        raise InputError("tell has to be a function of a level, and watch a Watch; leave them out")
    if not isinstance(stop, Stop | None):
        raise InputError(f"stop is {shown(repr(stop))}; it has to be one such as ul.Stop(tolerance=1e-8)")
    limits = {"max_unknowns": max_unknowns, "max_seconds": max_seconds, "max_memory": max_memory}
    if accuracy is None:
        _check_sizes_alone(limits, absolute=absolute, dry_run=dry_run, norm=norm != NORMS[0])
        stop = stop or Stop()
        own_mesh, cells = _sizes(problem, h, H, mesh, stop)
        data = scaled(problem)
        on = meshes.similar(own_mesh, data.polygon), partitions.similar(cells, data.polygon)
        with warnings.catch_warnings(action="ignore", category=IterationWarning):  # `_told` tells it
            solved = cheapest(data, *on, stop).solved(stop)
        solved.forget()
        return _told(Solution(solved, problem), isinstance(mesh, Mesh))
    if h is not None or H is not None or isinstance(mesh, Mesh):
        raise InputError("an accuracy chooses the sizes and the mesh; give either it or h and H")
    if isinstance(problem, Sampled):
        raise InputError(f"'{problem.name}': f, g and q must be formulas, or no accuracy can be guaranteed")
    if mesh == "structured" and problem.units.length != 1:
        raise InputError(
            f"'{problem.name}': 'structured' is possible, but not with an accuracy if k and c differ; "
            "leave it out, or give h and H"
        )
    if not isinstance(norm, str) or norm not in NORMS:
        raise InputError(f"the norm '{norm}' is none of {', '.join(NORMS)}")
    if not 0 < accuracy < math.inf:
        raise InputError(f"the accuracy {accuracy:g} must be a positive number, such as 1e-2")
    if accuracy >= 1 and not absolute:
        raise InputError(f"the accuracy {accuracy:g} is relative and must be below 1, unless absolute=True")
    most = {name: _limit(name, limit) for name, limit in limits.items()}
    goal = Goal(accuracy, norm, **most, sharp=sharp or norm == "hm12", absolute=absolute)
    with warnings.catch_warnings(action="ignore", category=IterationWarning):
        levels = search(scaled(problem), goal, stop, mesh, tell, watch, dry_run)
    found = Solution(levels.best.solved, problem, levels)
    return found if dry_run else _told(found)


def _problem(given: object) -> AnyProblem:
    """The problem that is given, or that of a name."""
    if isinstance(given, str | os.PathLike):
        return load(given)
    if isinstance(given, problems.Problem | Sampled) or is_case(given):
        return given
    raise InputError(
        f"{shown(repr(given))} is not a problem; take ul.Problem(...), ul.case(name) or ul.load(path)"
    )


def _check_flags(**flags: object) -> None:
    for name, given in flags.items():
        if not isinstance(given, bool | np.bool_):
            raise InputError(f"{name} is {shown(repr(given))}; it has to be True or False")


def _check_sizes_alone(limits: Mapping[str, Size | None], **others: bool) -> None:
    """Raises InputError for what only an accuracy has a use for."""
    given = [name for name, limit in limits.items() if limit is not None]
    given += [name for name, other in others.items() if other]
    if given:
        raise InputError(
            f"{given[0]} is only for an accuracy; leave it out, or give an accuracy and no h and H"
        )


def _number(name: str, given: Size | None) -> float | None:
    """A number that may be a text, such as "1/64"."""
    if isinstance(given, str):
        return real(given, name)
    try:
        if isinstance(given, bool):
            raise TypeError
        return given if given is None else float(given)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{name} is {shown(repr(given))}; it has to be a number, or a text such as '1/64'"
        ) from None


def _limit(name: str, given: Size | None) -> float | None:
    """A limit, if there is one."""
    found = _number(name, given)
    if found is not None and not found > 0:
        raise InputError(f"{name} is {found:g}; it has to be above 0")
    return found


def _told(found: Solution, own_mesh: bool = False) -> Solution:
    """The solution; a warning tells what is less than what was wanted."""
    search = found.search
    if search and len(search.believed) < len(search.done):
        withdrawn = f"{len(search.done) - len(search.believed)} bounds {WITHDRAWN}"
        warnings.warn(withdrawn, SolutionWarning, stacklevel=3)
    if search and not search.certified:
        warnings.warn(_not_certified(search), SolutionWarning, stacklevel=3)
    elif not found.converged:
        warnings.warn(not_converged(found.solved.result.bound), SolutionWarning, stacklevel=3)
    if not found.unique:
        warnings.warn(f"lambda_H {not_unique(found.mesh, own_mesh)}", SolutionWarning, stacklevel=3)
    return found


def _not_certified(search: Search) -> str:
    """Why the accuracy is not certified, and what is reached: in the same terms, and as an error."""
    best = search.best
    parts = [f"the accuracy {best.goal.accuracy:g} is not certified: {search.ended}"]
    if not search.believed:
        parts.append("no bound is left")
    elif best.goal.absolute or not best.size > 0:
        parts.append(f"reached is {up(best.total, '.4e')}")
    else:
        share = up(relative(best.total, best.size), ".3g")
        parts.append(f"reached is {share} of {SIZE[best.goal.norm]}, or {up(best.total, '.4e')}")
    if search.refusal:
        parts.append(str(search.refusal))
    if search.reach:
        parts.append(f"an accuracy of {search.reach:g} is within reach")
    return "; ".join(parts)


def _sizes(
    problem: AnyProblem, h: float | None, H: float | None, given: Mesh | str, stop: Stop
) -> tuple[Mesh, Partition]:
    """The mesh and the partition of sizes h and H at most."""
    polygon, wanted_H = problem.polygon, _checked("H", H)
    if isinstance(given, Mesh):
        if h is not None:
            raise InputError("the mesh is given; leave h out")
        same = np.array_equal(given.polygon.vertices, polygon.vertices)
        mesh = given if same else meshes.from_arrays(polygon, given.points, given.triangles)
        return mesh, uniform(polygon, wanted_H)
    wanted_h = _checked("h", h)
    check_size(polygon, wanted_h)
    kind = given or natural_kind(polygon)
    edges = math.ceil(wanted_H / wanted_h * (1 - 1e-12))
    halvings = levels_for(polygon, wanted_H, edges, stop) if kind == "unstructured" and edges > 1 else 0
    if halvings:
        return meshes.following(uniform(polygon, 2**halvings * wanted_H), edges, halvings)
    return KINDS[kind](polygon, wanted_h), uniform(polygon, wanted_H)


def _checked(name: str, size: float | None) -> float:
    """A size that is given and positive."""
    if size is None:
        raise InputError(f"solve needs h and H, or an accuracy; {name} is missing")
    if not 0 < size < math.inf:
        raise InputError(f"{name} = {size:g} must be a positive number")
    return size
