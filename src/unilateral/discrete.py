"""The discrete problem of given data f, g, whether or not a solution is known, and its guaranteed errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from unilateral.bounds import TotalBound, total_bound
from unilateral.case import Case
from unilateral.condense import Condensed, condense
from unilateral.forms import load
from unilateral.mesh import Mesh
from unilateral.norms import first_steklov
from unilateral.partition import Partition
from unilateral.problem import Problem
from unilateral.quadrature import boundary_rule, triangle_rules
from unilateral.solve import Pair, Stop, guarded_beta, iterate, joined, pair, response
from unilateral.uzawa import LEAST, DualResult, residual_bound

Array = NDArray[np.float64]
FIRST = 0.01
"""Of the residual at lambda = 0: how far to iterate before the size of the error is known."""
AIM = 0.5
"""Of the tolerance, when the iteration goes on because the first one missed it."""


@dataclass(frozen=True, eq=False)
class Discrete:
    """(P_h*) of a problem on one mesh and one partition; `load` (n,) is (f, phi_i), `offset` (m,) is F(0)."""

    problem: Case | Problem
    free: tuple[int, ...]
    condensed: Condensed
    both: Pair
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
        problem, cells = self.problem, self.both.partition
        largest = problem.largest_source if isinstance(problem, Problem) else 0.0
        bound = total_bound(problem, self.mesh, cells, u_h, lambda_H, self.free, largest)
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

    def algebraic(self, norm: str) -> float:
        """The part of the iteration in that error: its bound, over beta for lambda."""
        if norm == "h1" or self.result.bound == 0:
            return self.result.bound
        return self.result.bound / self.discrete.beta if self.discrete.beta > 0 else math.inf

    def size(self, norm: str) -> float:
        """A lower bound of the norm of the exact solution, from that of the discrete one."""
        return max((self.u_norm if norm == "h1" else self.lambda_norm) - self.total(norm), 0.0)


def discretise(
    problem: Case | Problem, mesh: Mesh, partition: Partition, free: Sequence[int] = ()
) -> Discrete:
    """The discrete problem, factorised, without multipliers on a problem's free sides and those given."""
    own = problem.free_sides if isinstance(problem, Problem) else ()
    free = tuple(sorted({*own, *free}))
    condensed = condense(mesh)
    both = pair(condensed, partition, free)
    f = source_load(problem, mesh)
    offset = both.offset(condensed.solve(f)[mesh.boundary], obstacle_means(problem, partition))
    if np.max(np.abs(offset), initial=0.0) < LEAST:
        offset[:] = 0.0  # of data that this mesh does not see
    return Discrete(problem, free, condensed, both, f, offset)


def source_load(problem: Case | Problem, mesh: Mesh) -> Array:
    """(n,) values of (f, phi_i), by quadrature."""
    moments = np.zeros((len(mesh.triangles), 3))
    for rule in triangle_rules(mesh, problem):
        f = problem.source(rule.origin, rule.offset).reshape(rule.weight.shape)
        np.add.at(moments, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
    return load(mesh, moments)


def obstacle_means(problem: Case | Problem, partition: Partition) -> Array:
    """(m,) cell means of g, by quadrature."""
    rule = boundary_rule(problem.polygon, partition.points, problem.singular())
    g, _ = problem.obstacle(rule.side, rule.s)
    return rule.integrate(g, partition.n_cells) / partition.lengths


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
