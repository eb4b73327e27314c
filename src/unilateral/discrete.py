"""The discrete problem of given data f, g, whether or not a solution is known, and its guaranteed errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from unilateral.bounds.source import Source, enclosed
from unilateral.bounds.total import SUMS, TotalBound, total_bound
from unilateral.fem.condense import Condensed, condense
from unilateral.fem.p1 import load
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact import first_steklov
from unilateral.problems.case import Case
from unilateral.problems.problem import Problem
from unilateral.solve import Pair, Stop, guarded_beta, iterate, joined, pair, response
from unilateral.solvers.uzawa import LEAST, DualResult, residual_bound

Array = NDArray[np.float64]
FIRST = 0.01
"""Of the residual at lambda = 0: how far to iterate before the size of the error is known."""
AIM = 0.5
"""Of the tolerance, when the iteration goes on because the first one missed it."""


@dataclass(frozen=True, eq=False)
class Discrete:
    """(P_h*) of a problem on one mesh and one partition; `load` (n,) is (f, phi_i), `offset` (m,) is F(0).

    `source` is f on the mesh, from which the load was taken.
    """

    problem: Case | Problem
    free: tuple[int, ...]
    condensed: Condensed
    both: Pair
    source: Source
    load: Array
    offset: Array

    @property
    def mesh(self) -> Mesh:
        return self.condensed.mesh

    @cached_property
    def beta(self) -> float:
        """What serves as beta, see `guarded_beta`."""
        return guarded_beta(self.both, first_steklov(self.condensed)) if len(self.offset) else 1.0

    @cached_property
    def first_residual(self) -> float:
        """The algebraic bound of lambda = 0."""
        operator = self.both.operator
        zero = np.zeros(len(self.offset))
        return residual_bound(operator, self.offset, zero, 1.9 / operator.lambda_max) if len(zero) else 0.0

    def response(self, mu: Array) -> Array:
        """u(mu) (n,) of (5.1) for mu (m,) on the cells that are not free."""
        return response(self.condensed, self.both, self.load, mu)

    def bounded(self, result: DualResult) -> Bounded:
        """The solution that belongs to lambda_H, and its guaranteed errors."""
        u_h = self.response(result.lambda_H)
        lambda_H = self.both.extended(result.lambda_H)
        obstacle, cells = self.problem.enclosed_obstacle, self.both.partition
        bound = total_bound(self.source, obstacle, cells, u_h, lambda_H, self.free)
        u_norm = math.sqrt(max(float(u_h @ (self.condensed.A @ u_h)), 0.0))
        lambda_norm = float(np.linalg.norm(self.both.operator.half @ result.lambda_H))
        return Bounded(self, result, u_h, lambda_H, bound, u_norm, lambda_norm)


@dataclass(frozen=True, eq=False)
class Bounded:
    """u_h (n,), lambda_H on all cells, and guaranteed bounds of their errors.

    `u_norm` is ||u_h||_1 and `lambda_norm` is ||lambda_H||_{-1/2,h}, which is at most ||lambda_H||_{-1/2}.
    """

    discrete: Discrete
    result: DualResult
    u_h: Array
    lambda_H: Array
    bound: TotalBound
    u_norm: float
    lambda_norm: float

    def total(self, norm: str) -> float:
        """The bound of ||u - u_h||_1 ("h1") or ||lambda - lambda_H||_{-1/2} ("hm12")."""
        return self.bound.u if norm == "h1" else self.bound.lambda_

    @property
    def u_integral(self) -> float:
        """The integral of u_h."""
        mesh = self.discrete.mesh
        return float(mesh.areas @ self.u_h[mesh.triangles].mean(axis=1))

    @property
    def force(self) -> float:
        """The integral of lambda_H."""
        return float(self.discrete.both.partition.lengths @ self.lambda_H)

    def algebraic(self, norm: str) -> float:
        """The part of the iteration in that error: its bound, over beta for lambda."""
        if norm == "h1" or self.result.bound == 0:
            return self.result.bound
        return self.result.bound / self.discrete.beta if self.discrete.beta > 0 else math.inf

    def size(self, norm: str) -> float:
        """A lower bound of the norm of the exact solution, from that of the discrete one."""
        of_discrete = self.u_norm if norm == "h1" else self.lambda_norm
        return max((1 - SUMS) * of_discrete - self.total(norm), 0.0)


def discretise(
    problem: Case | Problem, mesh: Mesh, partition: Partition, free: Sequence[int] = ()
) -> Discrete:
    """The discrete problem, factorised, without multipliers on a problem's free sides and those given."""
    own = problem.free_sides if isinstance(problem, Problem) else ()
    free = tuple(sorted({*own, *free}))
    condensed = condense(mesh)
    both = pair(condensed, partition, free)
    source = enclosed(mesh, problem)
    f = load(mesh, source.moments)
    offset = both.offset(condensed.solve(f)[mesh.boundary], problem.enclosed_obstacle.means(partition.points))
    if np.max(np.abs(offset), initial=0.0) < LEAST:
        offset[:] = 0.0  # of data that this mesh does not see
    return Discrete(problem, free, condensed, both, source, f, offset)


def solve_to_fraction(discrete: Discrete, stop: Stop) -> Bounded:
    """The solution with an algebraic error of at most `stop.tolerance`, else `stop.fraction` of the bound.

    That bound is of ||u - u_h||_1; it is known after a first, cruder, solve.
    """
    if stop.tolerance is not None:
        return discrete.bounded(iterate(discrete.both.operator, discrete.offset, stop.tolerance, stop, None))
    solved = discrete.bounded(
        iterate(discrete.both.operator, discrete.offset, FIRST * discrete.first_residual, stop, None)
    )
    return improved(solved, stop.fraction * solved.bound.u, stop)


def improved(solved: Bounded, tolerance: float, stop: Stop) -> Bounded:
    """The same, iterated on until the algebraic bound is at most `tolerance`."""
    if solved.result.bound <= tolerance or not solved.result.converged:
        return solved
    operator, offset = solved.discrete.both.operator, solved.discrete.offset
    result = iterate(operator, offset, AIM * tolerance, stop, solved.result.lambda_H)
    return solved.discrete.bounded(joined(solved.result, result))
