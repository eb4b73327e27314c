"""The discrete problem (P_h*) on a mesh that is refined where it is needed.

It offers what `discrete` offers for the problem that is condensed to the boundary, and `nested` for uniform
refinement, in a time and a memory that are nearly proportional to the number of unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from unilateral.arrays import Array, Index
from unilateral.bounds.kept import kept
from unilateral.bounds.source import Source, enclosed
from unilateral.discrete import FIRST, flux_load, obstacle_means
from unilateral.discrete_solution import AIM, Solution
from unilateral.fem.p1 import coupling, h1_norm, load, lumped_mass, stiffness_and_mass
from unilateral.fem.rounded import dual_norm
from unilateral.geometry.adapted import AdaptedMesh, refined
from unilateral.geometry.adapted import adapted as adapted_mesh
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.data import Data
from unilateral.solvers.iterate import joined
from unilateral.solvers.primal_dual import Settled, System, riesz, settled
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult

ROUGH = 1e-3
"""Of ||lambda_H||'s own: how far the v that bounds it from below is iterated."""


@dataclass(frozen=True, eq=False)
class Adapted:
    """(P_h*) with the `system` for the multipliers on the `cells` (m,); its iteration begins at `guess` (n,).

    `g_means` (all cells,) are those of g. Each cell has a node inside, so multipliers are `unique`; as no
    lower bound of `beta` is known, 1 is put for it: algebraic bounds are then in ||.||_{-1/2,h}. The load is
    that of the `source`, by which f is enclosed, and of q.
    """

    of: AdaptedMesh
    cells: Index
    g_means: Array
    system: System
    guess: Array
    data: Data
    source: Source
    unique: bool = True
    beta: float = 1.0

    @property
    def mesh(self) -> Mesh:
        return self.of.mesh

    @property
    def partition(self) -> Partition:
        return self.of.partition

    @property
    def load(self) -> Array:
        """(n,)"""
        return self.system.load

    @cached_property
    def first_bound(self) -> float:
        """The algebraic bound of u = 0 and lambda = 0."""
        return self.system.bound(np.zeros(len(self.load)), np.zeros(len(self.cells)))

    def solved(self, stop: Stop) -> Solution:
        """(u_h, lambda_H), its algebraic bound at most `stop.tolerance`.

        Else it is at most `stop.fraction` of the bound of ||u - u_h||_1.
        """
        solution = self.iterated(stop.tolerance, stop)
        return solution if stop.tolerance is not None else solution.within(stop)

    def iterated(self, tolerance: float | None, stop: Stop, start: Array | None = None) -> Solution:
        """The same for a tolerance or, with None, a share of the bound at 0.

        Cells with start (m,) > 0 are active first, by default all.
        """
        active = np.ones(len(self.cells), dtype=bool) if start is None else start > 0
        wanted = FIRST * self.first_bound if tolerance is None else tolerance
        return self._solution(settled(self.system, self.guess, active, wanted), wanted)

    def continued(self, solution: Solution, tolerance: float, stop: Stop) -> Solution:
        """The solution, iterated on to a smaller tolerance."""
        found = settled(self.system, solution.u_h, solution.result.lambda_H > 0, tolerance)
        more = self._solution(found, tolerance)
        return replace(more, result=joined(solution.result, more.result))

    def errors(self, lambda_H: Array) -> None:
        """Not seen from these spaces: `norms.dual.errors` integrates them."""

    def lambda_norm(self, lambda_H: Array) -> float:
        """A lower bound of ||lambda_H||_{-1/2,h}, lambda_H (m,): <lambda_H, v> / ||v||_1 for one v."""
        R = self.system.B.T @ lambda_H
        v = riesz(self.system, R, ROUGH * dual_norm(R, self.system.mass))
        norm = h1_norm(self.of.mesh, v)
        return max(float(R @ v), 0.0) / norm if norm > 0 else 0.0

    def _solution(self, found: Settled, tolerance: float) -> Solution:
        lambda_H = np.zeros(self.partition.n_cells)
        lambda_H[self.cells] = found.lambda_H
        converged = found.bound <= tolerance
        result = DualResult(
            found.lambda_H, found.systems, found.steps, found.bound, converged, math.nan, "active_set"
        )
        return Solution(self, result, tolerance, lambda_H, found.u)


def refinements(
    problem: Data, mesh: Mesh, stop: Stop, chosen: Callable[[Solution], Index], most: float
) -> Iterator[Solution]:
    """The solutions on a mesh, two of whose boundary edges make a cell, and on finer ones of `most` unknowns.

    Of each mesh the triangles (k,) are refined that are `chosen` by its solution, from which the next one
    starts. Algebraic bounds are at most `stop.fraction` of those of ||u - u_h||_1. Raises InputError as
    `chosen` does.
    """
    of, u, last = adapted_mesh(mesh), np.zeros(mesh.n_nodes), None
    while of.mesh.n_nodes <= most:
        last = _after(last, adapted(problem, of, u, last.discrete.source if last else None), stop)
        yield last
        of, u = refined(of, chosen(last), last.u_h)


def _after(last: Solution | None, discrete: Adapted, stop: Stop) -> Solution:
    """The solution of a problem, from that on the mesh before, if there is one."""
    if last is None:
        return discrete.solved(stop)
    start = last.discrete.partition.means(last.lambda_H, discrete.partition.points)[discrete.cells]
    return discrete.iterated(AIM * stop.fraction * last.total("h1"), stop, start).within(stop)


def adapted(problem: Data, of: AdaptedMesh, guess: Array, before: Source | None = None) -> Adapted:
    """The problem on a mesh and its cells, without multipliers on free sides; `guess` (n,) is near u_h.

    With f as it is enclosed `before`, on a mesh from which this one was refined, only new triangles are
    looked at.
    """
    mesh, partition = of.mesh, of.partition
    source = kept(before, mesh, problem) if before else enclosed(mesh, problem)
    cells = np.flatnonzero(~np.isin(partition.side, problem.free_sides))
    means, nb = obstacle_means(problem, partition), len(mesh.boundary)
    at_nodes = sp.csr_array((np.ones(nb), (np.arange(nb), mesh.boundary)), shape=(nb, mesh.n_nodes))
    system = System(
        A=sum(stiffness_and_mass(mesh)),
        load=load(mesh, source.moments) + flux_load(problem, mesh),
        B=(coupling(mesh, partition)[cells] @ at_nodes).tocsr(),
        d=(partition.lengths * means)[cells],
        inside=of.inside[cells],
        mass=lumped_mass(mesh),
    )
    return Adapted(of, cells, means, system, guess, problem, source)
