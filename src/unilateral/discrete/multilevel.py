"""The discrete problem (P_h*) on a mesh that was made by refinement, solved by multigrid.

It offers what `condensed` offers for the problem that is condensed to the boundary, without dense matrices:
time and memory are proportional to the number of unknowns, on uniform and on adapted meshes alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array, Index
from unilateral.bounds.constraint import build_constraint
from unilateral.bounds.enclosed_data import EnclosedData, enclose_data
from unilateral.bounds.source import Source, enclose_source
from unilateral.discrete.base import RETRY_TOLERANCE_SHARE, DiscreteProblem
from unilateral.discrete.problem_data import case_load, obstacle_means, problem_form
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.form import H1, Form
from unilateral.fem.hierarchy import Hierarchy, build_hierarchy
from unilateral.fem.nested_cells import LevelCells, nested_cells
from unilateral.fem.residual_rounding import max_row_entries
from unilateral.formulas.taylor import EPS
from unilateral.geometry.adapted import AdaptedMesh, mark_triangles, refine_and_balance, start_adapted_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.problem import Problem
from unilateral.solvers.multigrid import RESIDUAL_NORM_SHARE, Multigrid, MultigridResult, build_multigrid
from unilateral.solvers.multigrid_bounds import multiplier_norm_lower_bound
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

MAX_COARSE_UNKNOWNS = 50_000
"""The coarsest mesh, whose matrix is factorised, has at most this many unknowns."""


@dataclass(frozen=True, eq=False)
class NestedSpaces:
    """The spaces on the `hierarchy` of a mesh, with the cells of its last levels."""

    mesh: Mesh
    partition: Partition
    hierarchy: Hierarchy
    level_cells: list[LevelCells]


@dataclass(frozen=True, eq=False, repr=False)
class MultilevelProblem(DiscreteProblem):
    """(P_h*) on nested spaces.

    The iteration begins at `start_u` (n,), which is 0 at clamped nodes, by default on coarser levels. Each
    cell has a node inside, so lambda_H is `unique`. No lower bound on `beta` is known, so it is set to 1:
    algebraic bounds are then in ||.||_{-1/2,h}.
    """

    spaces: NestedSpaces
    start_u: Array | None = None

    @property
    def unique(self) -> bool:
        """Whether lambda_H is known to be the only one: always, since each cell has a node inside."""
        return True

    @property
    def beta(self) -> float:
        """The number 1 in place of beta, with which algebraic bounds are in ||.||_{-1/2,h}."""
        return 1.0

    @cached_property
    def multigrid(self) -> Multigrid:
        """The problem on all levels of its spaces."""
        load, g_means = self.homogeneous_data
        integrals = (self.partition.lengths * g_means)[self.cells]
        return build_multigrid(self.spaces.hierarchy, self.spaces.level_cells, load, integrals)

    def solve(self, stop: Stop) -> DiscreteSolution:
        """The solution (u_h, lambda_H) with an algebraic bound up to the tolerance of `stop`.

        Without a tolerance it is at most `stop.fraction` of an estimate of ||u - u_h||_1 or, where there are
        no coarser levels to begin with, of the bound on that. The algebraic bound itself is guaranteed.
        """
        solution = self.iterate(stop.tolerance, stop)
        if stop.tolerance is not None or len(self.multigrid.grids) > 1:
            return solution
        return self.improve_to_fraction(solution, stop)

    def iterate(
        self,
        tolerance: float | None,
        stop: Stop,
        start: Array | None = None,
        predicted_total: float = math.inf,
    ) -> DiscreteSolution:
        """The solution up to a tolerance, if one is given; cells with start (m,) > 0 are active first.

        Where the bound on the total error will be about `predicted_total`, the residual is made small against
        that, too.
        """
        first_guess = None if self.start_u is None or start is None else (self.start_u, start > 0)
        max_residual_norm = RESIDUAL_NORM_SHARE * predicted_total
        return self._convert_result(
            self.multigrid.solve(tolerance, first_guess, stop.fraction, max_residual_norm=max_residual_norm)
        )

    def iterate_further(self, solution: DiscreteSolution, tolerance: float, stop: Stop) -> DiscreteSolution:
        """The solution, iterated further to a smaller tolerance."""
        start = solution.u_h - self.dirichlet_lift, solution.result.lambda_H > 0
        max_residual_norm = RESIDUAL_NORM_SHARE * tolerance / stop.fraction
        further_result = self.multigrid.solve(tolerance, start, max_residual_norm=max_residual_norm)
        further_solution = self._convert_result(further_result)
        return replace(further_solution, result=further_solution.result.add_counts(solution.result))

    def lambda_norm(self, lambda_H: Array) -> float:
        """A lower bound on ||lambda_H||_{-1/2,h}."""
        return multiplier_norm_lower_bound(self.multigrid.grids, lambda_H)

    def _convert_result(self, multigrid_result: MultigridResult) -> DiscreteSolution:
        """The solution u_D + u of a multigrid result, with the steps on the finest level as its steps."""
        finest = multigrid_result.iteration_counts[-1][0]
        steps = sum(count for level, count in multigrid_result.iteration_counts if level == finest)
        u_h = self.dirichlet_lift + multigrid_result.u
        bound = multigrid_result.bound + self._bound_lift_rounding(u_h)
        result = DualResult(
            multigrid_result.lambda_H,
            iterations=steps,
            operator_applications=steps,
            bound=bound,
            converged=multigrid_result.converged,
            rho=math.nan,
            algorithm="multigrid",
        )
        return self.make_solution(result, multigrid_result.tolerance, u_h)

    def _bound_lift_rounding(self, u_h: Array) -> float:
        """A bound on the norm of what rounding has done to the sum u_h of the Dirichlet lift and u."""
        if not self.dirichlet_lift.any():
            return 0.0
        # ||e||^2 <= (entries in a row) sum A_ii e_i^2 for e with |e_i| <= EPS |u_i|, as A_ij^2 <= A_ii A_jj
        A = self.multigrid.finest.hierarchy.A
        return EPS * max_row_entries(A) ** 0.5 * float(dnrm2(np.sqrt(A.diagonal()) * u_h))


def nested_spaces(
    mesh: Mesh, partition: Partition, hierarchy: Hierarchy | None = None, form: Form = H1
) -> NestedSpaces | None:
    """The spaces on the levels of a mesh: those of a `hierarchy`, if it is given, else those for a form.

    None where the mesh has no coarse level, or one of more than MAX_COARSE_UNKNOWNS, or where its levels
    cannot follow the partition: a point of the partition is no node of the mesh, or a cell has one edge only.
    """
    coarse = mesh.coarse or mesh
    if hierarchy is None and (not mesh.steps or coarse.n_nodes > MAX_COARSE_UNKNOWNS):
        return None
    levels = hierarchy or build_hierarchy(mesh, form=form)
    nested = nested_cells(levels, partition)
    return None if nested is None else NestedSpaces(mesh, partition, levels, nested)


def discretise_on_nested_spaces(
    problem: Problem, spaces: NestedSpaces, source: Source | None = None, start_u: Array | None = None
) -> MultilevelProblem:
    """The problem on its spaces, with f as the `source` has it, if that is known.

    The iteration begins at the `start_u` (n,). The data of a case are only enclosed where its f is, or where
    the iteration ends by a bound on the error, as it does on one level.
    """
    mesh = spaces.mesh
    partition = spaces.partition
    form = spaces.hierarchy.form
    data: EnclosedData | None = None
    # nested iteration ends by an estimate of the error, so that a case needs no bound, and no enclosed data
    if problem.exact and source is None and len(spaces.level_cells) > 1:
        load = case_load(problem.exact, mesh)
        clamped_values = np.zeros(mesh.n_nodes)
        if form.clamped:
            clamped_values = build_constraint(problem.enclosed_obstacle, mesh, form).clamped_values
    else:
        data = enclose_data(problem, mesh, form, source)
        load = data.load
        clamped_values = data.constraint.clamped_values
    return MultilevelProblem(
        mesh=mesh,
        partition=partition,
        cells=np.flatnonzero(form.has_multiplier(partition.side)),
        load=load,
        g_means=obstacle_means(problem, partition),
        data=data,
        form=form,
        dirichlet_lift=_extend_clamped_values(clamped_values, mesh, form),
        spaces=spaces,
        start_u=start_u,
    )


def _extend_clamped_values(clamped_values: Array, mesh: Mesh, form: Form) -> Array:
    """The function (n,) with these values on clamped sides that falls to 0 on triangles of the first mesh.

    In nested iteration u_h less this function is as smooth as u_h, but for what the values are not linear.
    """
    lift = clamped_values.copy()
    if form.clamped:
        clamped_nodes = form.clamped_nodes(mesh)
        for step in mesh.steps:
            new_nodes = slice(step.n_old_nodes, step.n_old_nodes + len(step.ends))
            means = lift[step.ends].mean(axis=1)
            lift[new_nodes] = np.where(clamped_nodes[new_nodes], lift[new_nodes], means)
    return lift


def discretise_on_adapted_mesh(
    problem: Problem,
    adapted: AdaptedMesh,
    previous: MultilevelProblem | None = None,
    previous_solution: DiscreteSolution | None = None,
) -> MultilevelProblem:
    """The problem on a mesh and its cells.

    If this mesh was refined from that of the problem `previous`, whose solution is `previous_solution`, f is
    enclosed on new triangles only, and the iteration begins at that solution.
    """
    mesh = adapted.mesh
    form = previous.form if previous else problem_form(problem, mesh)
    known_source = previous.data.source if previous and previous.data else None
    source = enclose_source(mesh, problem.source, form, known_source)
    hierarchy = build_hierarchy(mesh, previous.spaces.hierarchy if previous else None, form)
    # the last solution, less its Dirichlet lift, interpolated on the new levels
    start_u = np.zeros(mesh.n_nodes)
    if previous and previous_solution:
        start_u[: len(previous_solution.u_h)] = previous_solution.u_h - previous.dirichlet_lift
        for level in hierarchy.levels:
            if level.n > len(previous_solution.u_h):
                level.prolong(start_u)
    spaces = nested_spaces(mesh, adapted.partition, hierarchy)
    assert spaces is not None
    return discretise_on_nested_spaces(problem, spaces, source, start_u)


def solve_refinements(
    problem: Problem,
    mesh: Mesh,
    stop: Stop,
    choose_triangles: Callable[[DiscreteSolution], Index],
    max_unknowns: float,
) -> Iterator[DiscreteSolution]:
    """The solutions on a mesh with two boundary edges in each cell, and on finer and finer ones.

    `choose_triangles` gives the triangles (k,) of a mesh that are refined, from the solution on it. The next
    solve starts from that solution. Algebraic bounds are at most `stop.fraction` of those on ||u - u_h||_1.
    Raises InputError as `choose_triangles` does.
    """
    adapted = start_adapted_mesh(mesh)
    discrete: MultilevelProblem | None = None
    solution: DiscreteSolution | None = None
    while adapted.mesh.n_nodes <= max_unknowns:
        discrete = discretise_on_adapted_mesh(problem, adapted, discrete, solution)
        solution = _solve_from_previous(solution, discrete, stop)
        yield solution
        adapted = refine_and_balance(adapted, choose_triangles(solution))


def mark_by_bound(solution: DiscreteSolution) -> Index:
    """The triangles that half of the squared bound comes from, for `solve_refinements`."""
    return mark_triangles(solution.mesh, solution.bound_shares)


def _solve_from_previous(
    previous_solution: DiscreteSolution | None, discrete: MultilevelProblem, stop: Stop
) -> DiscreteSolution:
    """The solution of a problem, from that on the mesh before, if there is one."""
    if previous_solution is None:
        return discrete.improve_to_fraction(discrete.iterate(None, stop), stop)
    means = previous_solution.partition.means(previous_solution.lambda_H, discrete.partition.points)
    total = previous_solution.total_bound("h1")
    tolerance = RETRY_TOLERANCE_SHARE * stop.fraction * total
    solution = discrete.iterate(tolerance, stop, start=means[discrete.cells], predicted_total=total)
    return discrete.improve_to_fraction(solution, stop)
