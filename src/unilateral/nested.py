"""The discrete problem (P_h*) on a mesh that was made by refinement, solved by multigrid.

It offers what `discrete` offers for the problem that is condensed to the boundary, without dense matrices:
time and memory are proportional to the number of unknowns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.source import Source, enclosed
from unilateral.discrete import flux_load, obstacle_means
from unilateral.discrete_solution import Solution
from unilateral.fem.hierarchy import hierarchy
from unilateral.fem.loads import by_parts, case_moments, sampled_moments
from unilateral.fem.nested_cells import nested_cells
from unilateral.fem.p1 import load as p1_load
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.data import Data, is_case
from unilateral.problems.sampled import Sampled
from unilateral.solvers.iterate import joined
from unilateral.solvers.multigrid import Found, Multigrid, multigrid
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

FINE = 66_000
"""Unknowns up to which residuals hardly count in the cheap bound, for 1 % of the error."""
MOST_COARSE = 50_000
"""Unknowns of the coarsest mesh, whose matrix is factorised."""


@dataclass(frozen=True, eq=False)
class Nested:
    """(P_h*) on nested spaces: `load` (n,) is that of f and q, `g_means` (cells,) are those of g.

    Multipliers are on the `cells` (m,) of the partition. Each has a node inside, so they are `unique`; as no
    lower bound of `beta` is known, 1 is put for it: algebraic bounds are then in ||.||_{-1/2,h}. f and g are
    enclosed where the `data` are formulas; `source` is f enclosed, where it has been, as the load may be made
    of that.
    """

    mesh: Mesh
    partition: Partition
    cells: Index
    load: Array
    g_means: Array
    grids: Multigrid
    data: Data | None
    source: Source | None
    unique: bool = True
    beta: float = 1.0

    def solved(self, stop: Stop) -> Solution:
        """(u_h, lambda_H), its algebraic bound at most `stop.tolerance`.

        And at most `stop.fraction` of an estimate of ||u - u_h||_1; the bound itself is guaranteed.
        """
        return self.iterated(stop.tolerance, stop)

    def iterated(self, tolerance: float | None, stop: Stop, start: Array | None = None) -> Solution:
        """The same for a tolerance, too, if one is given; coarser levels are the start.

        In the cheap guaranteed bound residuals weigh like 1/h. So the share of the estimate falls with h.
        """
        fraction = stop.fraction * min(1.0, math.sqrt(FINE / self.mesh.n_nodes))
        solution = self._solution(self.grids.solve(None, fraction=fraction))
        if tolerance is None:
            return solution
        if solution.result.bound <= tolerance:
            return replace(solution, tolerance=tolerance, result=replace(solution.result, converged=True))
        return solution.improved(tolerance, stop)

    def continued(self, solution: Solution, tolerance: float, stop: Stop) -> Solution:
        """The solution, iterated on to a smaller tolerance."""
        start = (solution.u_h, solution.result.lambda_H > 0)
        more = self._solution(self.grids.solve(tolerance, start))
        return replace(more, result=joined(solution.result, more.result))

    def errors(self, lambda_H: Array) -> None:
        """Not seen from these spaces: `norms.dual.errors` integrates them."""

    def lambda_norm(self, lambda_H: Array) -> float:
        """A lower bound of ||lambda_H||_{-1/2,h}, lambda_H (m,)."""
        return self.grids.dual_norm_below(lambda_H)

    def _solution(self, found: Found) -> Solution:
        lambda_H = np.zeros(self.partition.n_cells)
        lambda_H[self.cells] = found.lambda_H
        finest = found.counts[-1][0]
        steps = sum(count for level, count in found.counts if level == finest)
        result = DualResult(found.lambda_H, steps, steps, found.bound, found.converged, math.nan, "multigrid")
        return Solution(self, result, found.tolerance, lambda_H, found.u)


def nested(problem: Data | Sampled, mesh: Mesh, partition: Partition) -> Nested | None:
    """The problem on the levels of a mesh, without multipliers on its free sides.

    None where the mesh has no coarse level, or its levels cannot follow the partition: a point of that is no
    node of the mesh, or a cell has one edge only.
    """
    coarse = mesh.coarse or mesh
    if mesh.halvings == 0 or coarse.n_nodes > MOST_COARSE:
        return None
    levels = hierarchy(mesh)
    of_levels = nested_cells(levels, partition, problem.free_sides)
    if of_levels is None:
        return None
    cells = np.flatnonzero(~np.isin(partition.side, problem.free_sides))
    (load, source), means = _load(problem, mesh), obstacle_means(problem, partition)
    load = load + flux_load(problem, mesh)
    grids = multigrid(levels, of_levels, load, (partition.lengths * means)[cells])
    data = None if isinstance(problem, Sampled) else problem
    return Nested(mesh, partition, cells, load, means, grids, data, source)


def _load(problem: Data | Sampled, mesh: Mesh) -> tuple[Array, Source | None]:
    """(n,) values of (f, phi_i), and f enclosed where they are made of that."""
    if is_case(problem):
        return by_parts(mesh, partial(case_moments, problem)), None
    if isinstance(problem, Sampled):
        return by_parts(mesh, partial(sampled_moments, problem)), None
    source = enclosed(mesh, problem)
    return p1_load(mesh, source.moments), source
