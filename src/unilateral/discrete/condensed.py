"""The discrete problem (P_h*), condensed to the boundary, and its solution by an iteration there.

S is the scaled dual operator of `fem.spaces`, which the iteration applies; rho is the size of its steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.source import Source
from unilateral.discrete.base import NO_LIFT, DiscreteProblem
from unilateral.discrete.problem_data import problem_form
from unilateral.discrete.solution import DiscreteSolution
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.p1 import energy_norm
from unilateral.fem.residual_rounding import (
    Rounded,
    gap_with_rounding,
    load_with_rounding,
    lumped_dual_norm_bound,
    residual_with_rounding,
)
from unilateral.fem.spaces import FORM_ROUNDING, MixedSpaces, mixed_spaces
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.exact_errors import CaseProjections, project_case
from unilateral.problems.problem import Problem
from unilateral.solvers.algebraic_bound import condensed_algebraic_bound
from unilateral.solvers.dispatch import run_algorithm
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import SMALLEST_NORMAL, DualResult, residual_bound, warn_of_missed_tolerance
from unilateral.solvers.uzawa_steps import UZAWA_STEP_FACTOR

FIRST_TOLERANCE_SHARE = 0.01
"""Before the size of the error is known, the tolerance is this fraction of the residual at lambda = 0."""
ASSUMED_ERROR_SHARE = 1e-4
"""Where nothing is known of the errors, they are taken to be this fraction of the residual at lambda = 0."""
ROUNDING_ALLOWANCE = 2.0
"""A tolerance has room for this many times what rounding adds to the bound, as that depends on lambda_H."""
MAX_ROUNDING_EXCESS = 3e-4
"""The rounding of u_h may be overestimated by this fraction of the bound, which saves a solve."""
MAX_BOUNDED_UNKNOWNS = 100_000
"""Up to this many unknowns the error is bounded to find a tolerance, which takes 3 GB."""


@dataclass(frozen=True, eq=False, repr=False)
class CondensedProblem(DiscreteProblem):
    """(P_h*) on the `spaces`; `offset` (m,) is F(0).

    `exact` are the projections of the exact solution, by which true errors are known, None without one.
    """

    spaces: MixedSpaces
    offset: Array
    exact: CaseProjections | None = None

    @property
    def unique(self) -> bool:
        """Whether lambda_H is known to be the only one: S is not singular."""
        return not self.spaces.operator.is_singular

    @property
    def beta(self) -> float:
        """The number that serves as beta of (3.4)."""
        return self.spaces.beta

    def lambda_norm(self, lambda_H: Array) -> float:
        """Lower bound on the discrete dual norm of lambda_H, up to the rounding of A_3."""
        return (1 - FORM_ROUNDING) * float(dnrm2(self.spaces.operator.D_factor @ lambda_H))

    @cached_property
    def zero_result(self) -> DualResult:
        """The result lambda = 0 with its bound."""
        operator = self.spaces.operator
        zero = np.zeros(len(self.offset))
        rho = UZAWA_STEP_FACTOR / operator.lambda_max if len(zero) else math.nan
        bound = residual_bound(operator, self.offset, zero, rho) if len(zero) else 0.0
        result = DualResult(
            zero,
            iterations=0,
            operator_applications=0,
            bound=bound,
            converged=False,
            rho=rho,
            algorithm="none",
        )
        return self.add_rounding_to_bound(result, self.response(zero)) if bound < math.inf else result

    @cached_property
    def bound_floor(self) -> float:
        """The iteration's own bound at lambda = 0 times EPS: in double precision it falls no further."""
        operator = self.spaces.operator
        zero = np.zeros(len(self.offset))
        if not len(zero) or operator.is_singular:
            return 0.0
        return EPS * residual_bound(operator, self.offset, zero, UZAWA_STEP_FACTOR / operator.lambda_max)

    def crude_tolerance(self, share: float) -> float:
        """A tolerance: a `share` of the residual at lambda = 0, and what rounding may add to the bound."""
        zero = self.zero_result
        return share * (zero.bound - zero.rounding) + ROUNDING_ALLOWANCE * zero.rounding

    def solve(self, stop: Stop) -> DiscreteSolution:
        """The solution (u_h, lambda_H), by `solve_condensed_problem`."""
        return solve_condensed_problem(self, stop)

    def iterate(
        self,
        tolerance: float | None,
        stop: Stop,
        start: Array | None = None,
        predicted_total: float = math.inf,
    ) -> DiscreteSolution:
        """The solution by the algorithm that `stop` asks for, from lambda_H = start (m,) or 0.

        `predicted_total` is not needed: the residual of u_h is rounding, and small against any total. Without
        a tolerance a crude one is taken, a share of the residual at 0. What rounding adds to the bound
        depends on lambda_H, and is known at the end only. If the bound then misses the tolerance, the
        iteration goes on once.
        """
        operator = self.spaces.operator
        max_bound = self.crude_tolerance(FIRST_TOLERANCE_SHARE) if tolerance is None else tolerance
        # below the floor no step helps, so that the iteration is sent no further than there
        min_tolerance = self.bound_floor if max_bound < self.bound_floor else 0.0
        result = run_algorithm(operator, self.offset, max(max_bound, min_tolerance), stop, start)
        u_h = self.response(result.lambda_H)
        certified = self.add_rounding_to_bound(result, u_h, max_bound)
        second_tolerance = max_bound - ROUNDING_ALLOWANCE * certified.rounding
        if result.converged and certified.bound > max_bound and second_tolerance > min_tolerance:
            second_result = run_algorithm(operator, self.offset, second_tolerance, stop, result.lambda_H)
            u_h = self.response(second_result.lambda_H)
            certified = self.add_rounding_to_bound(second_result.add_counts(result), u_h, max_bound)
        if result.converged:
            warn_of_missed_tolerance(certified, max_bound)
        return self.make_solution(certified, max_bound, u_h)

    def iterate_further(self, solution: DiscreteSolution, tolerance: float, stop: Stop) -> DiscreteSolution:
        """The solution, iterated further to a smaller tolerance."""
        further_solution = self.iterate(tolerance, stop, solution.result.lambda_H)
        return replace(further_solution, result=further_solution.result.add_counts(solution.result))

    def response(self, lambda_H: Array) -> Array:
        """The function u_h that belongs to the multiplier lambda_H; shape (n,)."""
        return self.dirichlet_lift + self.spaces.response(self.homogeneous_data[0], lambda_H)

    def add_rounding_to_bound(self, result: DualResult, u_h: Array, tolerance: float = 0.0) -> DualResult:
        """The result with a bound for u_h (n,) as it was computed, which includes the rounding on the way."""
        bound = self._bound_computed_solution(result, u_h)
        rounding = max(bound - result.bound, 0.0)
        return replace(result, bound=bound, converged=bound <= tolerance, rounding=rounding)

    def _bound_computed_solution(self, result: DualResult, u_h: Array) -> float:
        """The algebraic bound for u_h (n,) as it was computed, from its gap F and its residual r."""
        spaces = self.spaces
        # F: the means of v - (g - u_D) for v = u_h - u_D, with their rounding
        v = u_h - self.dirichlet_lift
        g_means = self.homogeneous_data[1][self.cells]
        gap = gap_with_rounding(spaces.B, v[self.mesh.boundary], g_means, spaces.operator.H_i)
        delta = self._bound_equation_residual(v, result.lambda_H, MAX_ROUNDING_EXCESS * result.bound)
        return condensed_algebraic_bound(spaces.operator, result.lambda_H, gap, delta, result.rho)

    def _bound_equation_residual(self, v: Array, mu: Array, negligible_norm: float) -> float:
        """An upper bound delta on ||r||, r = load + B^T mu - A v for v = u_h - u_D, with all rounding.

        r is only rounding: v solves that equation. A solve makes delta sharper if it is above
        `negligible_norm`.
        """
        condensed = self.spaces.condensed
        boundary = self.mesh.boundary
        homogeneous_load = self.homogeneous_data[0]
        # B^T mu is 0 at inner nodes, where the load is not rounded
        load = Rounded(homogeneous_load.copy(), np.zeros(len(homogeneous_load)))
        load.values[boundary], load.rounding[boundary] = load_with_rounding(
            homogeneous_load[boundary], self.spaces.B, mu
        )
        residual = residual_with_rounding(*condensed.matrix_and_row_sums, v, load)
        # by the lumped mass; it is too large by up to 1/h
        delta = lumped_dual_norm_bound(np.abs(residual.values) + residual.rounding, condensed.nodal_weights)
        if delta > negligible_norm:
            # ||r|| <= ||z|| + ||r - A z|| with z = A^{-1} r
            z = condensed.solve(residual.values)
            correction_residual = residual_with_rounding(*condensed.matrix_and_row_sums, z, residual)
            sizes = np.abs(correction_residual.values) + correction_residual.rounding
            correction_norm = lumped_dual_norm_bound(sizes, condensed.nodal_weights)
            delta = (1 + FORM_ROUNDING) * energy_norm(self.mesh, z, self.form) + correction_norm
        return delta


def build_condensed_problem(
    spaces: MixedSpaces, load: Array, trace: Array | None, g_means: Array, dirichlet_lift: Array = NO_LIFT
) -> CondensedProblem:
    """The discrete problem with a load, the means of g, and a Dirichlet lift.

    `trace` (nb,) is A^{-1} times the load for u_h - u_D on the boundary, if it is known.
    """
    discrete = CondensedProblem(
        mesh=spaces.mesh,
        partition=spaces.partition,
        cells=spaces.cells,
        load=load,
        g_means=g_means,
        form=spaces.condensed.form,
        dirichlet_lift=dirichlet_lift,
        spaces=spaces,
        offset=np.zeros(len(spaces.cells)),
    )
    homogeneous_load, homogeneous_means = discrete.homogeneous_data
    # F(0): the means of A^{-1} load - g
    if trace is None:
        trace = spaces.condensed.solve(homogeneous_load)[spaces.mesh.boundary]
    discrete.offset[:] = spaces.B @ trace / spaces.operator.H_i - homogeneous_means[spaces.cells]
    return discrete


def discretise_case(spaces: MixedSpaces, exact: CaseProjections) -> CondensedProblem:
    """The discrete problem of a case whose exact solution is known on these spaces."""
    ritz = exact.ritz
    g_means = exact.cell_means.g_means
    discrete = build_condensed_problem(
        spaces, ritz.load, trace=ritz.load_trace, g_means=g_means, dirichlet_lift=ritz.dirichlet_lift
    )
    return replace(discrete, exact=exact)


def discretise(problem: Problem, mesh: Mesh, partition: Partition) -> CondensedProblem:
    """The problem on one mesh and one partition, factorised, without multipliers on its free sides."""
    condensed = condense(mesh, problem_form(problem, mesh))
    return discretise_on_condensed_spaces(problem, mixed_spaces(condensed, partition))


def discretise_on_condensed_spaces(
    problem: Problem, spaces: MixedSpaces, source: Source | None = None
) -> CondensedProblem:
    """The problem on its spaces, with f as the `source` has it, if that is known.

    The data of a case are not enclosed, which takes longer than to solve it. Raises InputError where S is 0.
    """
    if len(spaces.cells) and not spaces.operator.lambda_max:
        raise InputError(
            f"in the mesh of '{spaces.mesh.polygon.name}' every node on a side with contact is on a clamped "
            "side, too; take a smaller h, or ul.mesh(mesh, halvings=1) of your own mesh"
        )
    if problem.exact:
        return discretise_case(spaces, project_case(problem.exact, spaces))
    data = enclose_data(problem, spaces.mesh, spaces.condensed.form, source)
    g_means = problem.enclosed_obstacle.means(spaces.partition.points)
    discrete = build_condensed_problem(
        spaces, data.load, trace=None, g_means=g_means, dirichlet_lift=data.constraint.clamped_values
    )
    if np.max(np.abs(discrete.offset), initial=0.0) < SMALLEST_NORMAL:
        discrete.offset[:] = 0.0  # of data that this mesh does not see
    return replace(discrete, data=data)


def solve_condensed_problem(
    discrete: CondensedProblem,
    stop: Stop = Stop(),  # noqa: B008
    beta: float | None = None,
) -> DiscreteSolution:
    """The solution (u_h, lambda_H) with an algebraic bound up to a tolerance, or a fraction of other errors.

    Tolerance and fraction are those of `stop`. Where the exact solution is known, the fraction is kept in
    every norm that is judged; `beta`, a lower bound on the constant in (3.4), turns the algebraic bound
    into one in H^{-1/2}. Where there are data, and at most MAX_BOUNDED_UNKNOWNS, it is a fraction of the
    bound on ||u - u_h||_1, which is known after a first, cruder, solve, unless rounding hides it. Else it is
    one of the residual at lambda = 0.
    """
    if stop.tolerance is not None:
        return discrete.iterate(stop.tolerance, stop)
    bounded = discrete.data is not None and discrete.mesh.n_nodes <= MAX_BOUNDED_UNKNOWNS
    if discrete.exact is None and not bounded:
        return discrete.iterate(discrete.crude_tolerance(stop.fraction * ASSUMED_ERROR_SHARE), stop)
    if discrete.exact is None:
        first_solution = discrete.iterate(discrete.crude_tolerance(FIRST_TOLERANCE_SHARE), stop)
        return discrete.improve_to_fraction(first_solution, stop)
    return _solve_case(discrete, discrete.exact, stop, discrete.spaces.beta if beta is None else beta)


def _solve_case(
    discrete: CondensedProblem, exact: CaseProjections, stop: Stop, beta: float
) -> DiscreteSolution:
    """The solution of a case, with an algebraic bound up to a fraction of its smallest true error.

    It goes on from lambda_H if it is then still too large beside the H^{-1/2} error.
    """
    spaces = discrete.spaces
    solution = discrete.iterate(stop.fraction * exact.smallest_error_part(spaces), stop)
    if spaces.operator.is_singular or exact.cell_means.lambda_is_zero:
        return solution
    # of ||lambda - lambda_H||_{-1/2,h} <= ||lambda - lambda_H||_{-1/2} the bound over beta may be a fraction
    error = exact.ritz.discrete_dual_norm(exact.boundary_load(spaces, solution.result.lambda_H))
    # Nesterov's steps go on; from so near a start "auto" might choose plain Uzawa
    further_stop = replace(stop, algorithm="nesterov") if solution.result.algorithm == "nesterov" else stop
    return discrete.improve(solution, stop.fraction * error * beta, further_stop, tolerance_share=1.0)
