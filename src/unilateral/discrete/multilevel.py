"""The discrete problem (P_h*) on a mesh that was made by refinement, solved by multigrid.

It offers what `condensed` offers for the problem that is condensed to the boundary, without dense matrices:
time and memory are proportional to the number of unknowns, on uniform and on adapted meshes alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.source import Source, enclosed
from unilateral.discrete.base import AIM, DiscreteProblem, DiscreteSolution
from unilateral.discrete.condensed import flux_load, obstacle_means
from unilateral.fem.hierarchy import Hierarchy, hierarchy
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import by_parts, case_moments, sampled_moments
from unilateral.geometry.adapted import AdaptedMesh, refined
from unilateral.geometry.adapted import adapted as adapted_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.data import Data, is_case
from unilateral.problems.sampled import Sampled
from unilateral.solvers.multigrid import IN_L2, Multigrid, MultigridResult, multigrid
from unilateral.solvers.multigrid_bounds import dual_norm_below
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

MOST_COARSE = 50_000
"""The coarsest mesh, whose matrix is factorised, has at most this many unknowns."""


@dataclass(frozen=True, eq=False, repr=False)
class MultilevelProblem(DiscreteProblem):
    """(P_h*) on nested spaces. f and g are enclosed where the `data` are formulas.

    The iteration begins at the `guess` (n,), by default on coarser levels. `free` are the sides without
    multipliers. Each cell has a node inside, so lambda_H is `unique`. No lower bound on `beta` is known, so
    it is set to 1: algebraic bounds are then in ||.||_{-1/2,h}.
    """

    free: tuple[int, ...]
    guess: Array | None = None

    @property
    def unique(self) -> bool:
        return True

    @property
    def beta(self) -> float:
        return 1.0

    @cached_property
    def grids(self) -> Multigrid:
        """The levels, which are made again if they are asked for after they were forgotten."""
        grids = _grids(self, hierarchy(self.mesh))
        assert grids is not None
        return grids

    def forget(self) -> None:
        """Frees the levels, which take half of the memory and are needed for no bound on the total error."""
        vars(self).pop("grids", None)

    def solved(self, stop: Stop) -> DiscreteSolution:
        """(u_h, lambda_H), with an algebraic bound of at most `stop.tolerance`.

        Without a tolerance it is at most `stop.fraction` of an estimate of ||u - u_h||_1 or, where there are
        no coarser levels to begin with, of the bound on that. The algebraic bound itself is guaranteed.
        """
        solution = self.iterated(stop.tolerance, stop)
        if stop.tolerance is not None or len(self.grids.grids) > 1:
            return solution
        return solution.within(stop)

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
        start, in_L2 = (solution.u_h, solution.result.lambda_H > 0), IN_L2 * tolerance / stop.fraction
        more = self._solution(self.grids.solve(tolerance, start, in_L2=in_L2))
        return replace(more, result=more.result.after(solution.result))

    def lambda_norm(self, lambda_H: Array) -> float:
        return dual_norm_below(self.grids.grids, lambda_H)

    def _solution(self, of: MultigridResult) -> DiscreteSolution:
        lambda_H = np.zeros(self.partition.n_cells)
        lambda_H[self.cells] = of.lambda_H
        finest = of.counts[-1][0]
        steps = sum(count for level, count in of.counts if level == finest)
        result = DualResult(of.lambda_H, steps, steps, of.bound, of.converged, math.nan, "multigrid")
        return DiscreteSolution(self, result, of.tolerance, lambda_H, of.u)


def multilevel(problem: Data | Sampled, mesh: Mesh, partition: Partition) -> MultilevelProblem | None:
    """The problem on the levels of a mesh, without multipliers on its free sides.

    None where the mesh has no coarse level, or one of more than MOST_COARSE unknowns, or where its levels
    cannot follow the partition: a point of the partition is no node of the mesh, or a cell has one edge only.
    """
    coarse = mesh.coarse or mesh
    if not mesh.steps or coarse.n_nodes > MOST_COARSE:
        return None
    return _on_levels(problem, mesh, partition, hierarchy(mesh), *_load(problem, mesh))


def _on_levels(
    problem: Data | Sampled,
    mesh: Mesh,
    partition: Partition,
    levels: Hierarchy,
    load: Array,
    source: Source | None,
    guess: Array | None = None,
) -> MultilevelProblem | None:
    """The problem with the `load` of f (n,), or None if the `levels` cannot follow the partition."""
    cells = np.flatnonzero(~np.isin(partition.side, problem.free_sides))
    means, load = obstacle_means(problem, partition), load + flux_load(problem, mesh)
    data = None if isinstance(problem, Sampled) else problem
    discrete = MultilevelProblem(
        mesh, partition, cells, load, means, problem.free_sides, guess, data=data, source=source
    )
    grids = _grids(discrete, levels)
    if grids is None:
        return None
    vars(discrete)["grids"] = grids
    return discrete


def _grids(of: MultilevelProblem, levels: Hierarchy) -> Multigrid | None:
    """The problem on all levels, or None if these cannot follow the partition."""
    cells = nested_cells(levels, of.partition, of.free)
    if cells is None:
        return None
    return multigrid(levels, cells, of.load, (of.partition.lengths * of.g_means)[of.cells])


def after(last: DiscreteSolution | None, problem: Data, of: AdaptedMesh) -> MultilevelProblem:
    """The problem on a mesh and its cells, from the solution on a mesh from which this one was refined.

    f is enclosed on new triangles only. The iteration begins at that solution, which forgets its levels.
    """
    mesh, before = of.mesh, last.discrete if last else None
    known = before.grids.finest.of if isinstance(before, MultilevelProblem) else None
    source = enclosed(mesh, problem, before.source if before else None)
    levels, guess = hierarchy(mesh, known), np.zeros(mesh.n_nodes)
    if before:
        before.forget()
    if last:
        guess[: len(last.u_h)] = last.u_h
        for level in levels.levels:
            if level.n > len(last.u_h):
                level.prolong(guess)
    discrete = _on_levels(problem, mesh, of.partition, levels, source.load, source, guess)
    assert discrete is not None
    return discrete


def refinements(
    problem: Data, mesh: Mesh, stop: Stop, chosen: Callable[[DiscreteSolution], Index], most: float
) -> Iterator[DiscreteSolution]:
    """The solutions on a mesh with two boundary edges in each cell, and on finer ones, up to `most` unknowns.

    `chosen` gives the triangles (k,) of a mesh that are refined, from the solution on it. The next solve
    starts from that solution. Algebraic bounds are at most `stop.fraction` of those on ||u - u_h||_1. Raises
    InputError as `chosen` does.
    """
    of, last = adapted_mesh(mesh), None
    while of.mesh.n_nodes <= most:
        last = _solved(last, after(last, problem, of), stop)
        yield last
        of = refined(of, chosen(last))


def _solved(last: DiscreteSolution | None, discrete: MultilevelProblem, stop: Stop) -> DiscreteSolution:
    """The solution of a problem, from that on the mesh before, if there is one."""
    if last is None:
        return discrete.iterated(None, stop).within(stop)
    start = last.discrete.partition.means(last.lambda_H, discrete.partition.points)[discrete.cells]
    total = last.total("h1")
    return discrete.iterated(AIM * stop.fraction * total, stop, start, total).within(stop)


def _load(problem: Data | Sampled, mesh: Mesh) -> tuple[Array, Source | None]:
    """(n,) the load (f, phi_i), and the enclosure of f if the load is made of that."""
    if is_case(problem):
        return by_parts(mesh, partial(case_moments, problem)), None
    if isinstance(problem, Sampled):
        return by_parts(mesh, partial(sampled_moments, problem)), None
    source = enclosed(mesh, problem)
    return source.load, source
