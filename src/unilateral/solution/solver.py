"""A solver that is used again: what belongs to the mesh and the cells is made once, for all loads."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from functools import cached_property

from numpy.typing import ArrayLike

from unilateral.bounds.source import Source
from unilateral.discrete.base import DiscreteProblem
from unilateral.discrete.choice import choose_spaces, condensed_spaces, discretise_on_spaces
from unilateral.errors import InputError, IterationWarning, quote_input
from unilateral.fem.spaces import DualOperator, MixedSpaces
from unilateral.formulas.expression import Expression
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.problems.build import GivenOnSides, make_problem, replace_data
from unilateral.problems.named import find_problem
from unilateral.problems.problem import Problem
from unilateral.problems.reading import Given
from unilateral.solution.matrices import Matrices, assemble_matrices
from unilateral.solution.shortfalls import warn_of_shortfalls
from unilateral.solution.sizes import Size, check_mesh_kind, mesh_problem, read_optional_number
from unilateral.solution.solution import Solution
from unilateral.solvers.stop import Stop


class Solver:
    """A problem on given sizes, to be solved for many f, g and q.

    `problem` is one of `Problem`, `case` and `load`, or the name of a case or of a YAML file. It may also be
    a polygon, by its vertices (n, 2), or a mesh. Then `free_sides`, k, c, q and u are those of `Problem`, and
    each call gives f and g. h, H, `mesh` and `stop` are as in `solve`; a problem that was made of a mesh is
    solved on it. Raises InputError as `solve`.

    The mesh, its levels or the factors of its matrix, the partition and the coupling of both are made once.
    A call makes the loads of what it is given, and iterates. It never begins at an earlier solution, so that
    the same arguments give the same solution bit for bit, in whatever order. `mesh` and `partition` are those
    of all solutions.

    >>> import unilateral as ul
    >>> solver = ul.Solver([(0, 0), (1, 0), (1, 1), (0, 1)], h=1 / 16, H=1 / 8)
    >>> [round(solver(f=-1, g=-depth).forces().whole.value, 3) for depth in (0, 0.5, 1)]
    [0.967, 0.483, 0.0]
    """

    def __init__(
        self,
        problem: Problem | str | os.PathLike[str] | Polygon | Mesh | ArrayLike,
        h: Size | None = None,
        H: Size | None = None,
        *,
        mesh: Mesh | str = "",
        stop: Stop | None = None,
        free_sides: Sequence[int] = (),
        k: str | float = 1,
        c: str | float = 1,
        q: GivenOnSides = None,
        u: Mapping[int, Given] | None = None,
    ) -> None:
        check_mesh_kind(mesh)
        check_stop(stop)
        self.stop = stop or Stop()
        base_problem = find_problem(problem)
        if base_problem is None:
            base_problem = make_problem(problem, 0, 0, free_sides=free_sides, k=k, c=c, q=q, u=u)  # type: ignore[arg-type]
            self.has_data = False
        elif any(
            hasattr(value, "__array__") or value not in (default, None, [], {})
            for value, default in ((free_sides, ()), (k, 1), (c, 1), (q, None), (u, None))
        ):
            raise InputError("free_sides, k, c, q and u belong to a polygon; a problem has its own")
        else:
            self.has_data = True
        self._is_user_mesh = isinstance(mesh, Mesh) or base_problem.mesh is not None
        self.problem, self.mesh, self.partition = mesh_problem(
            base_problem, read_optional_number("h", h), read_optional_number("H", H), mesh, self.stop
        )
        self._spaces = choose_spaces(self.problem, self.mesh, self.partition, self.stop)
        self._source_enclosures: dict[Expression, Source] = {}

    def __call__(self, f: Given = None, g: GivenOnSides = None, q: GivenOnSides = None) -> Solution:
        """The solution for another f, g or q; what is not given is that of the problem.

        They are given as in `Problem`; arrays (n,) have a value for each of `mesh.points`. Raises InputError
        as `Problem`. Warns as `solve`.
        """
        problem, discrete = self._discretise(f, g, q)
        # `warn_of_shortfalls` says the same in terms of the solution
        with warnings.catch_warnings(action="ignore", category=IterationWarning):
            solution = Solution(problem, discrete.solve(self.stop))
        warn_of_shortfalls(solution, self._is_user_mesh)
        return solution

    def matrices(self, f: Given = None, g: GivenOnSides = None, q: GivenOnSides = None) -> Matrices:
        """The discrete problem's matrices, load and means of g."""
        discrete = self._discretise(f, g, q)[1]
        return assemble_matrices(discrete, lambda: self._operator)

    def __repr__(self) -> str:
        return (
            f"Solver of '{self.problem.name}': {self.mesh.n_nodes} nodes, {self.partition.n_cells} cells, "
            f"h = {self.mesh.h:.4g}, H = {self.partition.H:.4g}"
        )

    def _discretise(self, f: Given, g: GivenOnSides, q: GivenOnSides) -> tuple[Problem, DiscreteProblem]:
        """The problem with that f, g and q, and the discrete one."""
        # the enclosures of the problem's own f and of the last formula are kept for calls with the same one
        problem = self._replace_data(f, g, q)
        formula = problem.f if isinstance(problem.f, Expression) and problem.exact is None else None
        source = None if formula is None else self._source_enclosures.get(formula)
        discrete = discretise_on_spaces(problem, self._spaces, source)
        if formula is not None and discrete.data:
            enclosures = self._source_enclosures.items()
            self._source_enclosures = {f: source for f, source in enclosures if f == self.problem.f}
            self._source_enclosures[formula] = discrete.data.source
        return problem, discrete

    def _replace_data(self, f: Given, g: GivenOnSides, q: GivenOnSides) -> Problem:
        """The problem with the f, g and q that are given. Raises InputError where one of them is missing."""
        problem = self.problem
        missing = [name for name, value in (("f", f), ("g", g)) if value is None]
        if missing and not self.has_data:
            raise InputError(
                f"{missing[0]} is missing; a solver made from a polygon or a mesh needs f and g in each call"
            )
        if len(missing) == 2 and q is None:
            return problem
        if problem.exact and missing:
            raise InputError(
                f"'{problem.name}' is a case, whose f and g belong to its solution; give both f and g"
            )
        return replace_data(problem, self.mesh, f, g, q)

    @cached_property
    def _operator(self) -> DualOperator:
        """The dual operator of the condensed problem. Raises InputError where memory does not suffice."""
        spaces = self._spaces
        if not isinstance(spaces, MixedSpaces):
            spaces = condensed_spaces(spaces.mesh, spaces.partition, spaces.hierarchy.form)
        return spaces.operator


def check_stop(stop: Stop | None) -> None:
    """Raises InputError for what is no `Stop`."""
    if not isinstance(stop, Stop | None):
        raise InputError(
            f"stop is {quote_input(repr(stop))}; it has to be one such as ul.Stop(tolerance=1e-8)"
        )
