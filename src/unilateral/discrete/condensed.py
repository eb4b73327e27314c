"""The discrete problem (P_h*), condensed to the boundary, and its solution by an iteration there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array
from unilateral.bounds.mesh_data import enclose_data
from unilateral.bounds.source import Source
from unilateral.discrete.base import NOTHING, DiscreteProblem
from unilateral.discrete.loads import form_of
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.p1 import energy_norm
from unilateral.fem.residual_rounding import Rounded, constrained, dual_norm, loaded, residual
from unilateral.fem.spaces import FORMS, MixedSpaces, mixed_spaces
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import Exact, exact
from unilateral.problems.problem import Problem
from unilateral.solvers.algebraic_bound import certified
from unilateral.solvers.dispatch import iterate
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import LEAST, DualResult, residual_bound, warn_unless_converged

FIRST = 0.01
"""Before the size of the error is known, the tolerance is this fraction of the residual at lambda = 0."""
UNKNOWN = 1e-4
"""Where nothing is known of the errors, they are taken to be this fraction of the residual at lambda = 0."""
ROOM = 2.0
"""A tolerance has room for this many times what rounding adds to the bound.

It is more than once that, because what rounding adds depends on lambda_H.
"""
UNSEEN = 3e-4
"""The rounding of u_h may be overestimated by this fraction of the bound.

That saves a solve that would tell more.
"""
MOST_BOUNDED = 100_000
"""Up to this many unknowns the error is bounded to find a tolerance, which takes 3 GB."""


@dataclass(frozen=True, eq=False, repr=False)
class CondensedProblem(DiscreteProblem):
    """(P_h*) on the `spaces`; `offset` (m,) is F(0). True errors are known where the `exact` solution is."""

    spaces: MixedSpaces
    offset: Array
    exact: Exact | None = None

    @property
    def unique(self) -> bool:
        return not self.spaces.operator.singular

    @property
    def beta(self) -> float:
        return self.spaces.beta

    def lambda_norm(self, lambda_H: Array) -> float:
        """Lower bound on the discrete dual norm of lambda_H, up to the rounding of A_3."""
        return (1 - FORMS) * float(dnrm2(self.spaces.operator.half @ lambda_H))

    @cached_property
    def first(self) -> DualResult:
        """The result lambda = 0 with its bound."""
        operator = self.spaces.operator
        zero = np.zeros(len(self.offset))
        rho = 1.9 / operator.lambda_max if len(zero) else math.nan
        bound = residual_bound(operator, self.offset, zero, rho) if len(zero) else 0.0
        result = DualResult(zero, 0, 0, bound, False, rho, "none")
        return self.certify(result, self.response(zero)) if bound < math.inf else result

    @cached_property
    def least_bound(self) -> float:
        """The iteration's own bound at lambda = 0 times EPS: in double precision it falls no further."""
        operator = self.spaces.operator
        zero = np.zeros(len(self.offset))
        if not len(zero) or operator.singular:
            return 0.0
        return EPS * residual_bound(operator, self.offset, zero, 1.9 / operator.lambda_max)

    def crude(self, share: float) -> float:
        """A tolerance: a `share` of the residual at lambda = 0, and what rounding may add to the bound."""
        return share * (self.first.bound - self.first.rounding) + ROOM * self.first.rounding

    def solved(self, stop: Stop) -> DiscreteSolution:
        """(u_h, lambda_H), with an algebraic error up to `stop.tolerance`, or a fraction of other errors."""
        return solve(self, stop)

    def iterated(
        self, tolerance: float | None, stop: Stop, start: Array | None = None, total: float = math.inf
    ) -> DiscreteSolution:
        """The solution by the algorithm that `stop` asks for, from lambda_H = start (m,) or 0.

        `total` is not needed: the residual of u_h is rounding, and small against any total. Without a
        tolerance a crude one is taken, a share of the residual at 0. What rounding adds to the bound is known
        at the end only. If the bound then misses the tolerance, the iteration goes on once.
        """
        operator = self.spaces.operator
        wanted = self.crude(FIRST) if tolerance is None else tolerance
        least = self.least_bound if wanted < self.least_bound else 0.0
        result = iterate(operator, self.offset, max(wanted, least), stop, start)
        u_h = self.response(result.lambda_H)
        certified = self.certify(result, u_h, wanted)
        less = wanted - ROOM * certified.rounding
        if result.converged and certified.bound > wanted and less > least:
            more = iterate(operator, self.offset, less, stop, result.lambda_H)
            u_h = self.response(more.lambda_H)
            certified = self.certify(more.after(result), u_h, wanted)
        if result.converged:
            warn_unless_converged(certified, wanted)
        return self.solution(certified, wanted, u_h)

    def continued(self, solution: DiscreteSolution, tolerance: float, stop: Stop) -> DiscreteSolution:
        more = self.iterated(tolerance, stop, solution.result.lambda_H)
        return replace(more, result=more.result.after(solution.result))

    def response(self, lambda_H: Array) -> Array:
        """(n,) u_h for the multipliers lambda_H (m,)."""
        return self.held + self.spaces.response(self.of_rest[0], lambda_H)

    def certify(self, result: DualResult, u_h: Array, tolerance: float = 0.0) -> DualResult:
        """The result with a bound for u_h (n,) as it was computed, which includes the rounding on the way."""
        bound = self._rounded_bound(result, u_h)
        rounding = max(bound - result.bound, 0.0)
        return replace(result, bound=bound, converged=bound <= tolerance, rounding=rounding)

    def _rounded_bound(self, result: DualResult, u_h: Array) -> float:
        """The bound for u_h (n,) as it was computed."""
        spaces = self.spaces
        on = self.spaces.condensed
        boundary = self.mesh.boundary
        (of_f, g_means) = self.of_rest
        mu = result.lambda_H
        v = u_h - self.held
        load = Rounded(of_f.copy(), np.zeros(len(of_f)))
        load.values[boundary], load.doubt[boundary] = loaded(of_f[boundary], spaces.B, mu)
        left = residual(*on.for_products, v, load)
        gap = constrained(spaces.B, v[boundary], g_means[self.cells], spaces.operator.H_i)
        delta = dual_norm(np.abs(left.values) + left.doubt, on.mass)
        if delta > UNSEEN * result.bound:
            z = on.solve(left.values)
            rest = residual(*on.for_products, z, left)
            of_rest = dual_norm(np.abs(rest.values) + rest.doubt, on.mass)
            delta = (1 + FORMS) * energy_norm(self.mesh, z, self.form) + of_rest
        return certified(spaces.operator, mu, gap, delta, result.rho)


def with_load(
    spaces: MixedSpaces, load: Array, trace: Array | None, g_means: Array, held: Array = NOTHING
) -> CondensedProblem:
    """The problem with a load (n,), the means (cells,) of g and the values that u_h is `held` (n,) at.

    `trace` (nb,) is A^{-1} times the load of `of_rest` on the boundary, if it is known.
    """
    on = spaces.mesh, spaces.partition, spaces.cells, load, g_means, spaces, np.zeros(len(spaces.cells))
    discrete = CondensedProblem(*on, form=spaces.condensed.form, held=held)
    of_f, of_g = discrete.of_rest
    if trace is None:
        trace = spaces.condensed.solve(of_f)[spaces.mesh.boundary]
    discrete.offset[:] = spaces.B @ trace / spaces.operator.H_i - of_g[spaces.cells]
    return discrete


def with_solution(spaces: MixedSpaces, exact: Exact) -> CondensedProblem:
    """The problem of a case whose `exact` solution is known on these spaces; its data are not enclosed."""
    ritz = exact.ritz
    return replace(with_load(spaces, ritz.load, ritz.trace, exact.means.g_means, ritz.held), exact=exact)


def discretise(problem: Problem, mesh: Mesh, partition: Partition) -> CondensedProblem:
    """The problem on one mesh and one partition, factorised, without multipliers on its free sides."""
    return on_spaces(problem, mixed_spaces(condense(mesh, form_of(problem, mesh)), partition))


def on_spaces(problem: Problem, spaces: MixedSpaces, source: Source | None = None) -> CondensedProblem:
    """The problem on its spaces, with f as the `source` has it, if that is known.

    The data of a case are not enclosed, which takes longer than to solve it. Raises InputError where S is 0.
    """
    if len(spaces.cells) and not spaces.operator.lambda_max:
        raise InputError(
            f"the mesh of '{spaces.mesh.polygon.name}' has no node in contact that is not on a clamped side;"
            " take a smaller h, or ul.mesh(mesh, halvings=1) of your own mesh"
        )
    if problem.exact:
        return with_solution(spaces, exact(problem.exact, spaces))
    data = enclose_data(problem, spaces.mesh, spaces.condensed.form, source)
    g_means = problem.enclosed_obstacle.means(spaces.partition.points)
    discrete = with_load(spaces, data.load, None, g_means, data.constraint.clamped_values)
    if np.max(np.abs(discrete.offset), initial=0.0) < LEAST:
        discrete.offset[:] = 0.0  # of data that this mesh does not see
    return replace(discrete, data=data)


def solve(discrete: CondensedProblem, stop: Stop = Stop(), beta: float | None = None) -> DiscreteSolution:  # noqa: B008
    """(u_h, lambda_H), with an algebraic error of at most `stop.tolerance`, or a fraction of other errors.

    Without a tolerance the fraction is `stop.fraction`. Where the exact solution is known, it is kept in
    every norm that is judged; `beta`, a lower bound on the constant in (3.4), turns the algebraic bound into
    one in H^{-1/2}. Where there are data, and at most MOST_BOUNDED unknowns, it is a fraction of the bound on
    ||u - u_h||_1, which is known after a first, cruder, solve, unless rounding hides it. Else it is a share
    of the residual at lambda = 0.
    """
    if stop.tolerance is not None:
        return discrete.iterated(stop.tolerance, stop)
    bounded = discrete.data is not None and discrete.mesh.n_nodes <= MOST_BOUNDED
    if discrete.exact is None and not bounded:
        return discrete.iterated(discrete.crude(stop.fraction * UNKNOWN), stop)
    if discrete.exact is None:
        return discrete.within(discrete.iterated(discrete.crude(FIRST), stop), stop)
    return _to_exact(discrete, discrete.exact, stop, discrete.spaces.beta if beta is None else beta)


def _to_exact(discrete: CondensedProblem, exact: Exact, stop: Stop, beta: float) -> DiscreteSolution:
    """The solution of a case.

    It goes on from lambda_H if the H^{-1/2} error then still misses the fraction.
    """
    spaces = discrete.spaces
    solved = discrete.iterated(stop.fraction * exact.tolerance(spaces), stop)
    if spaces.operator.singular or exact.means.lambda_is_zero:
        return solved
    error = exact.ritz.discrete_dual(exact.boundary_load(spaces, solved.result.lambda_H))
    going_on = replace(stop, algorithm="nesterov") if solved.result.algorithm == "nesterov" else stop
    return discrete.improved(solved, stop.fraction * error * beta, going_on, aim=1.0)
