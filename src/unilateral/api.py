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

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from unilateral.adaptive.goal import DEFAULT_ACCURACY, GOAL_NORMS, Goal
from unilateral.adaptive.level import Level
from unilateral.adaptive.loop import search
from unilateral.discrete.choice import solve_on_mesh
from unilateral.errors import InputError, IterationWarning, quote_input
from unilateral.geometry.files import read_mesh
from unilateral.geometry.foreign import as_mesh, refine_within_memory
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems import arguments
from unilateral.problems import problem as problems
from unilateral.problems.arguments import as_vertices
from unilateral.problems.build import GivenOnSides, make_problem
from unilateral.problems.named import case, find_problem, load
from unilateral.problems.problem_file import load_polygon
from unilateral.problems.reading import Given
from unilateral.solution import certification
from unilateral.solution.forces import read_force_sides
from unilateral.solution.shortfalls import warn_of_shortfalls
from unilateral.solution.sizes import (
    MESH_KINDS,
    Size,
    check_mesh_kind,
    fit_mesh,
    mesh_problem,
    read_optional_number,
)
from unilateral.solution.solution import Solution
from unilateral.solution.solver import Solver, check_stop
from unilateral.solution.summary import LINEAR_PROBLEM_NOTE
from unilateral.solvers.stop import Stop
from unilateral.system.files import check_path

__all__ = ["MESH_KINDS", "Problem", "Solver", "case", "certify", "load", "mesh", "solve"]


def Problem(
    polygon: Polygon | Mesh | ArrayLike | str | os.PathLike[str],
    f: Given,
    g: GivenOnSides = None,
    free_sides: Sequence[int | str] | None = (),
    name: str = "problem",
    *,
    k: str | float = 1,
    c: str | float = 1,
    q: GivenOnSides = 0,
    u: Mapping[Any, Given] | None = None,
) -> problems.Problem:
    """A problem of one's own: -k lap u + c u = f, with an obstacle g on the sides that carry contact.

    On these u >= g, k du/dn >= 0 and (u - g) k du/dn = 0; for k = c = 1 this is (1.1)-(1.2). On the free
    sides k du/dn = q. Clamped sides are the keys of `u`, which has what u is there, or None for 0. c may be 0
    if a side is clamped. The errors are measured in the norm (k |v|_1^2 + c ||v||_0^2)^{1/2} and its dual.

    `polygon` has the vertices (n, 2), anticlockwise, or names a CSV file of them, or a mesh whose outline it
    is; side i runs from vertex i to the next, and may be given by its name. f, g for all sides with contact
    or one per side (None on the others), u on each clamped side, and q for all free sides or one per side
    (None on the others) are formulas in x and y, as in a problem file, functions of two arrays, or arrays.
    Without sides that carry contact g is left out.

    g and q may be dicts with sides as keys. On a side a pair of arrays, or a dict such as {"table":
    "surface.csv"}, is a table: distances s along it, from 0 to its length, and values, linear in between.

    An array (n,) has a value for each node of a mesh, which takes the place of the polygon: see `mesh`. It
    stands for the function that is linear on triangles and boundary edges; bounds are for that one. Of g, q
    and u the values at other nodes than those of their sides are not read. The problem is solved on that
    mesh, so `solve` takes H only.

    A function becomes the array of its values at the nodes of the mesh on which the problem is solved, and
    bounds are for the function that is linear between them. So `solve` takes sizes or a mesh, and no
    accuracy. A function that takes one point at a time is given as
    `np.vectorize(function, otypes=[float])`.

    Raises InputError as for a problem file, and for an array that does not fit the mesh, has masked numbers,
    integers or labels in another order than 0, 1, 2, …; a function may not return such an array either, and
    is called when the problem is put on a mesh.

    >>> import unilateral as ul
    >>> ul.Problem([(0, 0), (1, 0), (0, 1)], f="x - 1", g=[0, None, 0], free_sides=[1]).free_sides
    (1,)
    >>> ul.Problem([(0, 0), (1, 0), (0, 1)], f=-1, g="-y/4", c=0, u={0: "x*(1 - x)"}).clamped_sides
    (0,)
    """
    if f is None:
        raise InputError(f"{name}, field f: there is no formula; write 0 where there is none")
    return make_problem(polygon, f, g, free_sides=free_sides, name=name, k=k, c=c, q=q, u=u)


def mesh(
    given: object,
    triangles: ArrayLike | None = None,
    *,
    polygon: Polygon | problems.Problem | ArrayLike | str | os.PathLike[str] | None = None,
    halvings: int = 0,
) -> Mesh:
    """Triangles of one's own, as the mesh of a polygon.

    A mesh of scikit-fem or a triangulation of matplotlib will do as well as one of meshio, and so will a mesh
    that this function gave. On a mesh of a disc each boundary edge is a side of its own. A multiplier is
    unique if each side has two edges or more, as it has after one halving.

    Parameters
    ----------
    given : array_like (n, 2), str, path or mesh
        The points, or a file of one of meshio's formats, or a mesh of another program. Third coordinates have
        to be 0. Nodes of a file that belong to no triangle are left out.
    triangles : array_like of int (m, 3), with points
        The nodes of each triangle, either way round.
    polygon : optional
        Its vertices (k, 2), anticlockwise; a `Polygon`; a problem, whose polygon it is; or the name of a
        polygon or of a YAML file. If none is given the boundary of the triangles is the polygon. Its vertices
        are then the nodes at which the boundary turns by more than the rounding of coordinates explains.
    halvings : int
        How often all edges are halved then. The polygon stays.

    Returns
    -------
    Mesh
        Of exactly that polygon: nodes that lie beside a side because of rounding are moved onto it.

    Raises
    ------
    InputError
        For what is no triangulation of a polygon, and where it is not clear whether a turn of the boundary is
        a corner or rounding; the polygon is then asked for.

    Warns
    -----
    SolutionWarning
        Where turns of the boundary were taken for rounding, and where nodes were left out.

    >>> import unilateral as ul
    >>> mesh = ul.mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)], halvings=1)
    >>> mesh.points.shape, mesh.triangles.shape, mesh.polygon.n_sides
    ((9, 2), (8, 3), 4)
    """
    domain = _as_polygon(polygon)
    if isinstance(given, str | os.PathLike) and triangles is None:
        return refine_within_memory(read_mesh(check_path(given, "mesh.msh"), domain), halvings)
    return refine_within_memory(as_mesh(given, triangles, domain), halvings)


def _as_polygon(polygon_or_name: object) -> Polygon | None:
    """The polygon that is given by its vertices, by what has it, or by a name."""
    if polygon_or_name is None or isinstance(polygon_or_name, Polygon):
        return polygon_or_name
    if isinstance(polygon_or_name, str | os.PathLike):
        return load_polygon(str(check_path(polygon_or_name, "problem.yaml")))
    domain = getattr(polygon_or_name, "polygon", None)
    return domain if isinstance(domain, Polygon) else Polygon(as_vertices(polygon_or_name, "polygon"))


def solve(
    problem: problems.Problem | str | os.PathLike[str],
    h: Size | None = None,
    H: Size | None = None,
    accuracy: Size | None = None,
    *,
    norm: str = "h1",
    sides: Sequence[int | str] | None = None,
    mesh: Mesh | str = "",
    stop: Stop | None = None,
    max_unknowns: float | None = None,
    max_seconds: float | None = None,
    max_memory: float | None = None,
    sharp: bool = False,
    absolute: bool = False,
    dry_run: bool = False,
    tell: Callable[[Level], None] | None = None,
    begin: float | None = None,
) -> Solution:
    """The solution on given sizes h and H, or up to an accuracy that is then guaranteed.

    If neither is given, the accuracy is 0.05; a mesh of one's own and functions need sizes.

    The problem is one of `Problem`, `case` and `load`, or the name of a case or of a YAML file.
    h is the longest boundary edge of the mesh, H the longest cell of the multiplier's partition; take h < H,
    such as H = 2h. Large meshes are refined from coarse ones and solved by multigrid.
    `mesh` is "structured", "unstructured" or a mesh of one's own, which takes the place of h. For an accuracy
    that mesh is the coarsest, and is refined.

    An accuracy is that of u in H1, or with `norm` "hm12" of lambda in H^{-1/2}. It is relative to that norm
    of the solution; if it is `absolute`, it is the largest error itself. With `norm` "force" it is half of
    the width of the interval of the force over the `sides`, over that force: over all sides with contact by
    default, and with the reactions on clamped ones. It is certified by the cheap bound on u, or by the
    `sharp` one; lambda and forces take the sharp one. The solution's `certified` says whether it was reached
    within `max_unknowns`, `max_seconds` (by default 600) and `max_memory` MB (by default what is free). A
    limit that is given is used up if need be; without one the search ends as soon as the accuracy is out of
    reach. Limits are looked at before each level; Ctrl-C keeps the levels that are finished. The seconds
    count from `begin`, a time of `time.perf_counter()`, by default from the call. `tell` is called with every
    level. A `dry_run` ends after the first levels, and the solution's `search.plan` says what the accuracy
    takes.

    Raises BudgetError where a limit leaves no result, and InputError for what does not fit together, or not
    into the memory. Warns by a SolutionWarning where the iteration did not converge, where the
    accuracy was not reached, and where lambda_H may not be unique.

    >>> import unilateral as ul
    >>> ul.solve(ul.case("natural"), accuracy=0.1).certified
    True
    """
    start_time = _read_start_time(begin)
    problem = _as_problem(problem)
    h = read_optional_number("h", h)
    H = read_optional_number("H", H)
    accuracy = read_optional_number("the accuracy", accuracy)
    check_mesh_kind(mesh)
    check_stop(stop)
    arguments.check_flags(sharp=sharp, absolute=absolute, dry_run=dry_run)
    without_sizes = h is None and H is None and accuracy is None and not absolute
    is_user_mesh = isinstance(mesh, Mesh) or problem.mesh is not None
    if without_sizes and not is_user_mesh and not problem.has_functions:
        accuracy = DEFAULT_ACCURACY
    if not (tell is None or callable(tell)):
        raise InputError("tell has to be a function of a level; leave it out")
    limits = {"max_unknowns": max_unknowns, "max_seconds": max_seconds, "max_memory": max_memory}
    # on given sizes
    if accuracy is None:
        is_default_norm = isinstance(norm, str) and norm == GOAL_NORMS[0]
        _refuse_accuracy_options(
            limits,
            absolute=absolute,
            dry_run=dry_run,
            norm=not is_default_norm,
            sides=sides is not None,
        )
        stop = stop or Stop()
        problem, triangulation, partition = mesh_problem(problem, h, H, mesh, stop)
        solution = Solution(problem, solve_on_mesh(problem, triangulation, partition, stop))
        warn_of_shortfalls(solution, is_user_mesh)
        return solution
    # up to an accuracy, on meshes that the search makes
    if h is not None or H is not None:
        raise InputError("an accuracy makes its own meshes; leave it out, or leave out h and H")
    _refuse_data_of_one_mesh(problem)
    goal = Goal(
        accuracy,
        norm,
        **{name: read_optional_number(name, limit) for name, limit in limits.items()},
        sharp=sharp or norm != "h1",
        absolute=absolute,
        kind=mesh if isinstance(mesh, str) else "",
        stop=stop or Stop(),
        sides=_read_goal_sides(problem, norm, sides),
    )
    _refuse_goal_without_contact(problem, goal)
    # `warn_of_shortfalls` says the same in terms of the solution
    with warnings.catch_warnings(action="ignore", category=IterationWarning):
        coarsest = fit_mesh(mesh, problem.polygon) if isinstance(mesh, Mesh) else None
        levels = search(problem, goal, tell, dry_run, start_time, coarsest)
    solution = Solution(problem, levels.best.solved, levels)
    if not dry_run:
        warn_of_shortfalls(solution)
    return solution


def certify(
    problem: problems.Problem | str | os.PathLike[str],
    mesh: object,
    u: ArrayLike,
    multiplier: ArrayLike | None = None,
) -> Solution:
    """Guaranteed bounds on the errors of a u that any program computed, whatever it is.

    The problem is solved on the same mesh, with two boundary edges in each cell. From that solution come
    lambda_H, whose error `bounds.multiplier` bounds, and the flux by which `bounds.u` is near the error of u.

    Parameters
    ----------
    problem
        A problem as in `solve`; its functions become linear between their values at the nodes of the mesh.
    mesh
        What `mesh` takes, on the problem's polygon: a file, a mesh of scikit-fem, or (points, triangles).
    u : array_like (n,)
        Values at the nodes in the order of `mesh`, of the function that is linear on triangles. Where u < g,
        or u has other values on clamped sides than the given ones, the bounds count that.
    multiplier : array_like (nb,), optional
        A number >= 0 for each boundary edge, anticlockwise from vertex 0, to be used as lambda_H. On free and
        clamped sides it is 0 or NaN. A linear problem is then solved in place of the contact problem.

    Returns
    -------
    Solution
        The one with the `u` that was given; its `error_shares` say where the error may be.

    Raises
    ------
    InputError
        For a mesh of another polygon, and for values that do not fit the mesh or are not finite.

    Warns
    -----
    SolutionWarning
        As `solve`, and where most of the bound comes from u < g, as with a small penalty parameter.

    >>> import unilateral as ul
    >>> square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    >>> right, half = (ul.solve(ul.Problem(square, f, "-x*y/2"), h=1 / 16, H=1 / 8) for f in (-1, -1 / 2))
    >>> [round(ul.certify(right.problem, right.mesh, s.u).bounds.u, 2) for s in (right, half)]
    [0.02, 0.17]
    """
    problem = _as_problem(problem)
    solution = certification.certify_nodal_values(problem, _as_mesh_of_problem(problem, mesh), u, multiplier)
    warn_of_shortfalls(solution, is_user_mesh=True)
    return solution


def _as_mesh_of_problem(problem: problems.Problem, mesh_or_points: object) -> Mesh:
    """The mesh that is given, on the polygon of a problem; a problem of a mesh takes no other one."""
    problem_mesh = problem.mesh
    triangulation = mesh_or_points
    if not (
        isinstance(triangulation, Mesh)
        and np.array_equal(triangulation.polygon.vertices, problem.polygon.vertices)
    ):
        points = mesh_or_points
        triangles = None
        if isinstance(mesh_or_points, tuple) and len(mesh_or_points) == 2:
            points, triangles = mesh_or_points
        triangulation = mesh(points, triangles, polygon=problem.polygon)
    if problem_mesh and not (
        np.array_equal(triangulation.points, problem_mesh.points)
        and np.array_equal(triangulation.triangles, problem_mesh.triangles)
    ):
        raise InputError(
            f"'{problem.name}' has arrays at the nodes of another mesh; give the mesh of the problem"
        )
    return problem_mesh or triangulation


def _as_problem(problem_or_name: object) -> problems.Problem:
    """The problem that is given, or that of a name."""
    problem = find_problem(problem_or_name)
    if problem is None:
        raise InputError(
            f"{quote_input(repr(problem_or_name))} is not a problem; take ul.Problem(...), ul.case(name) or "
            "ul.load(path)"
        )
    return problem


def _read_goal_sides(
    problem: problems.Problem, norm: str, sides: Sequence[int | str] | None
) -> tuple[int, ...]:
    """The sides whose force an accuracy is for: those that are given, or all with contact; () for a norm.

    Raises InputError for sides that have no force.
    """
    is_force = isinstance(norm, str) and norm == "force"
    if not is_force and sides is None:
        return ()
    if not is_force:
        raise InputError("sides is only for the norm 'force'; leave it out")
    if sides is None:
        return tuple(problem.contact_sides)
    numbers = read_force_sides(sides, problem.polygon, problem.clamped_sides)
    with_force = tuple(side for side in numbers if side not in problem.free_sides)
    if not with_force:
        raise InputError(f"sides {numbers} are free sides, where the flux is given; name others")
    return with_force


def _read_start_time(begin: float | None) -> float:
    """The time from which seconds count, by default now. Raises InputError for one that has not passed."""
    now = perf_counter()
    begin = read_optional_number("begin", begin)
    if begin is None:
        return now
    if not begin <= now:
        raise InputError(f"begin is {begin:g}; it has to be a time of time.perf_counter() that has passed")
    return begin


def _refuse_data_of_one_mesh(problem: problems.Problem) -> None:
    """Raises InputError for data that mean something on one mesh only, where an accuracy takes several."""
    if problem.mesh is not None:
        raise InputError(
            f"'{problem.name}' has a mesh of its own, and an accuracy chooses meshes; give H instead, or "
            "make the problem from the polygon"
        )
    if problem.has_functions:
        raise InputError(
            f"'{problem.name}': f, g, q and u must be formulas for an accuracy, because functions have other "
            "values between the nodes of each mesh; give h and H"
        )


def _refuse_goal_without_contact(problem: problems.Problem, goal: Goal) -> None:
    """Raises InputError for an accuracy of lambda or of a force where no side has contact."""
    needs_contact = goal.norm == "hm12" or (goal.norm == "force" and not goal.sides)
    if needs_contact and not problem.contact_sides:
        raise InputError(f"'{problem.name}': {LINEAR_PROBLEM_NOTE}; ask for an accuracy of u, in the norm h1")


def _refuse_accuracy_options(limits: Mapping[str, Size | None], **flags: bool) -> None:
    """Raises InputError for what only an accuracy has a use for."""
    options = [name for name, limit in limits.items() if limit is not None]
    options += [name for name, is_set in flags.items() if is_set]
    if options:
        raise InputError(f"{options[0]} is only for an accuracy; leave it out, or give an accuracy")
