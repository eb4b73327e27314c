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
from unilateral.bounds.constraint import constraint
from unilateral.bounds.mesh_data import MeshData, enclose_data
from unilateral.bounds.source import Source, enclose_source
from unilateral.discrete.base import AIM, DiscreteProblem
from unilateral.discrete.loads import case_load, form_of, obstacle_means
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.form import H1, Form
from unilateral.fem.hierarchy import Hierarchy, hierarchy
from unilateral.fem.nested_cells import Cells, nested_cells
from unilateral.fem.residual_rounding import terms
from unilateral.formulas.taylor import EPS
from unilateral.geometry.adapted import AdaptedMesh, refined
from unilateral.geometry.adapted import adapted as adapted_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.problem import Problem
from unilateral.solvers.multigrid import IN_L2, Multigrid, MultigridResult, multigrid
from unilateral.solvers.multigrid_bounds import dual_norm_below
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

MOST_COARSE = 50_000
"""The coarsest mesh, whose matrix is factorised, has at most this many unknowns."""


@dataclass(frozen=True, eq=False)
class NestedSpaces:
    """The spaces on the `levels` of a mesh, with the cells of the last levels; see `nested_cells`."""

    mesh: Mesh
    partition: Partition
    levels: Hierarchy
    nested: list[Cells]


@dataclass(frozen=True, eq=False, repr=False)
class MultilevelProblem(DiscreteProblem):
    """(P_h*) on nested spaces.

    The iteration begins at the `guess` (n,), which is 0 at fixed nodes, by default on coarser levels. Each
    cell has a node inside, so lambda_H is `unique`. No lower bound on `beta` is known, so it is set to 1:
    algebraic bounds are then in ||.||_{-1/2,h}.
    """

    spaces: NestedSpaces
    guess: Array | None = None

    @property
    def unique(self) -> bool:
        return True

    @property
    def beta(self) -> float:
        return 1.0

    @cached_property
    def grids(self) -> Multigrid:
        """The problem on all levels of its spaces."""
        load, g_means = self.of_rest
        integrals = (self.partition.lengths * g_means)[self.cells]
        return multigrid(self.spaces.levels, self.spaces.nested, load, integrals)

    def solved(self, stop: Stop) -> DiscreteSolution:
        """(u_h, lambda_H), with an algebraic bound of at most `stop.tolerance`.

        Without a tolerance it is at most `stop.fraction` of an estimate of ||u - u_h||_1 or, where there are
        no coarser levels to begin with, of the bound on that. The algebraic bound itself is guaranteed.
        """
        solution = self.iterated(stop.tolerance, stop)
        if stop.tolerance is not None or len(self.grids.grids) > 1:
            return solution
        return self.within(solution, stop)

    def iterated(
        self, tolerance: float | None, stop: Stop, start: Array | None = None, total: float = math.inf
    ) -> DiscreteSolution:
        """The solution up to a tolerance, if one is given; cells with start (m,) > 0 are active first.

        Where the bound on the total error will be about `total`, the residual is made small against that,
        too.
        """
        begin = None if self.guess is None or start is None else (self.guess, start > 0)
        return self._solution(self.grids.solve(tolerance, begin, stop.fraction, IN_L2 * total))

    def continued(self, solution: DiscreteSolution, tolerance: float, stop: Stop) -> DiscreteSolution:
        start = solution.u_h - self.held, solution.result.lambda_H > 0
        more = self._solution(self.grids.solve(tolerance, start, in_L2=IN_L2 * tolerance / stop.fraction))
        return replace(more, result=more.result.after(solution.result))

    def lambda_norm(self, lambda_H: Array) -> float:
        return dual_norm_below(self.grids.grids, lambda_H)

    def _solution(self, of: MultigridResult) -> DiscreteSolution:
        finest = of.counts[-1][0]
        steps = sum(count for level, count in of.counts if level == finest)
        u_h = self.held + of.u
        bound = of.bound + self._rounding(u_h)
        result = DualResult(of.lambda_H, steps, steps, bound, of.converged, math.nan, "multigrid")
        return self.solution(result, of.tolerance, u_h)

    def _rounding(self, u_h: Array) -> float:
        """A bound on the norm of what rounding has done to the sum `held` + of.u."""
        if not self.held.any():
            return 0.0
        A = self.grids.finest.of.A
        return EPS * terms(A) ** 0.5 * float(dnrm2(np.sqrt(A.diagonal()) * u_h))


def nested_spaces(
    mesh: Mesh, partition: Partition, known: Hierarchy | None = None, form: Form = H1
) -> NestedSpaces | None:
    """The spaces on the levels of a mesh, which may be `known`, or else those for a form.

    None where the mesh has no coarse level, or one of more than MOST_COARSE unknowns, or where its levels
    cannot follow the partition: a point of the partition is no node of the mesh, or a cell has one edge only.
    """
    coarse = mesh.coarse or mesh
    if known is None and (not mesh.steps or coarse.n_nodes > MOST_COARSE):
        return None
    levels = known or hierarchy(mesh, form=form)
    nested = nested_cells(levels, partition)
    return None if nested is None else NestedSpaces(mesh, partition, levels, nested)


def on_levels(
    problem: Problem, spaces: NestedSpaces, source: Source | None = None, guess: Array | None = None
) -> MultilevelProblem:
    """The problem on its spaces, with f as the `source` has it, if that is known.

    The iteration begins at the `guess` (n,). The data of a case are only enclosed where its f is, or where
    the iteration ends by a bound on the error, as it does on one level.
    """
    mesh = spaces.mesh
    partition = spaces.partition
    form = spaces.levels.form
    data: MeshData | None = None
    if problem.exact and source is None and len(spaces.nested) > 1:
        load = case_load(problem.exact, mesh)
        clamped_values = np.zeros(mesh.n_nodes)
        if form.clamped:
            clamped_values = constraint(problem.enclosed_obstacle, mesh, form).clamped_values
    else:
        data = enclose_data(problem, mesh, form, source)
        load = data.load
        clamped_values = data.constraint.clamped_values
    return MultilevelProblem(
        mesh=mesh,
        partition=partition,
        cells=np.flatnonzero(form.held(partition.side)),
        load=load,
        g_means=obstacle_means(problem, partition),
        data=data,
        form=form,
        held=_extended(clamped_values, mesh, form),
        spaces=spaces,
        guess=guess,
    )


def _extended(clamped_values: Array, mesh: Mesh, form: Form) -> Array:
    """(n,) the function with these values on clamped sides, which falls to 0 on triangles of the first mesh.

    In nested iteration u_h less this function is as smooth as u_h, but for what the values are not linear.
    """
    held = clamped_values.copy()
    if form.clamped:
        fixed = form.fixed(mesh)
        for step in mesh.steps:
            new = slice(step.n, step.n + len(step.ends))
            held[new] = np.where(fixed[new], held[new], held[step.ends].mean(axis=1))
    return held


def discretise_nested(
    problem: Problem,
    of: AdaptedMesh,
    before: MultilevelProblem | None = None,
    last: DiscreteSolution | None = None,
) -> MultilevelProblem:
    """The problem on a mesh and its cells.

    If this mesh was refined from that of the problem `before`, whose solution is the `last` one, f is
    enclosed on new triangles only, and the iteration begins at that solution.
    """
    mesh = of.mesh
    form = before.form if before else form_of(problem, mesh)
    known = before.data.source if before and before.data else None
    source = enclose_source(mesh, problem.source, form, known)
    levels = hierarchy(mesh, before.spaces.levels if before else None, form)
    guess = np.zeros(mesh.n_nodes)
    if before and last:
        guess[: len(last.u_h)] = last.u_h - before.held
        for level in levels.levels:
            if level.n > len(last.u_h):
                level.prolong(guess)
    spaces = nested_spaces(mesh, of.partition, levels)
    assert spaces is not None
    return on_levels(problem, spaces, source, guess)


def refinements(
    problem: Problem, mesh: Mesh, stop: Stop, chosen: Callable[[DiscreteSolution], Index], most: float
) -> Iterator[DiscreteSolution]:
    """The solutions on a mesh with two boundary edges in each cell, and on finer ones, up to `most` unknowns.

    `chosen` gives the triangles (k,) of a mesh that are refined, from the solution on it. The next solve
    starts from that solution. Algebraic bounds are at most `stop.fraction` of those on ||u - u_h||_1. Raises
    InputError as `chosen` does.
    """
    of = adapted_mesh(mesh)
    discrete: MultilevelProblem | None = None
    last: DiscreteSolution | None = None
    while of.mesh.n_nodes <= most:
        discrete = discretise_nested(problem, of, discrete, last)
        last = _solved(last, discrete, stop)
        yield last
        of = refined(of, chosen(last))


def _solved(last: DiscreteSolution | None, discrete: MultilevelProblem, stop: Stop) -> DiscreteSolution:
    """The solution of a problem, from that on the mesh before, if there is one."""
    if last is None:
        return discrete.within(discrete.iterated(None, stop), stop)
    start = last.partition.means(last.lambda_H, discrete.partition.points)[discrete.cells]
    total = last.total("h1")
    solution = discrete.iterated(AIM * stop.fraction * total, stop, start, total)
    return discrete.within(solution, stop)
