"""One discrete problem solved and measured: the choice of the algorithm, the stop, the errors.

The stop is absolute, in ||.||_{-1/2,h}: a fraction of the smallest discretisation error, both of whose
parts are known before iterating; and the iteration goes on where the H^{-1/2} error then still misses it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from unilateral.errors import InputError
from unilateral.fem.condense import Condensed, DualOperator, dual_operator
from unilateral.fem.coupling import coupling
from unilateral.geometry.partition import Partition
from unilateral.norms.exact import OnCells, OnMesh
from unilateral.solvers.active_set import active_set
from unilateral.solvers.steps import STEPS
from unilateral.solvers.uzawa import DualResult, predicted_steps, residual_bound, uzawa

Array = NDArray[np.float64]
ALGORITHMS = ("auto", *STEPS, "active_set")
STEKLOV_GUARD = 0.5
"""sigma_1 is known from above, by its Ritz value; half of it is taken where beta is not known."""


@dataclass(frozen=True)
class Stop:
    """When and how the iteration ends.

    `fraction` is the share of the discretisation error that the algebraic error may have; an absolute
    `tolerance` takes its place. `rho` None is 1.9 / lambda_max(S). The `algorithm` "auto" is the active
    set where S is singular, Nesterov where no rho is given and more than `max_steps` plain steps are
    predicted, else plain Uzawa. Raises InputError for an unknown algorithm, and a rho without a use.
    """

    fraction: float = 0.01
    tolerance: float | None = None
    max_steps: int = 200_000
    algorithm: str = "auto"
    rho: float | None = None

    def __post_init__(self) -> None:
        if self.algorithm not in ALGORITHMS:
            known = ", ".join(ALGORITHMS)
            raise InputError(f"the algorithm '{self.algorithm}' is unknown; the known ones are {known}")
        if self.algorithm == "active_set" and self.rho is not None:
            raise InputError(
                "the algorithm active_set has no step rho; leave rho out, or take uzawa or nesterov"
            )


@dataclass(frozen=True, eq=False)
class Pair:
    """What one mesh and one partition share for every case: B (m, nb) and the dual operator.

    They belong to the m `cells` of the partition, those that lie on no free side.
    """

    partition: Partition
    B: sp.csr_array
    operator: DualOperator
    cells: NDArray[np.intp]

    def offset(self, trace: Array, g_means: Array) -> Array:
        """F(0) (m,): the cell means of A^{-1} f - g, from A^{-1} f (nb,) and the means of g on all cells."""
        return self.B @ trace / self.operator.H_i - g_means[self.cells]

    def extended(self, lambda_H: Array) -> Array:
        """lambda_H (m,) as a function on all cells, 0 on free sides."""
        found = np.zeros(self.partition.n_cells)
        found[self.cells] = lambda_H
        return found


@dataclass(frozen=True, eq=False)
class Solution:
    """lambda_H on all cells with its algebraic certificate, and the errors; NaN where it is not judged.

    `hm12_discrete` is ||lambda - lambda_H||_{-1/2,h}; `quadrature_share` is the share of h1_error^2
    that an exact quadrature would not have; `balance` is |int u_h - int f - int lambda_H|.
    """

    result: DualResult
    lambda_H: Array
    tolerance: float
    u_h: Array
    h1_error: float
    hm12_discrete: float
    l2_error: float
    quadrature_share: float
    balance: float


def pair(condensed: Condensed, partition: Partition, free: Sequence[int] = ()) -> Pair:
    """The coupling and the dual operator of a mesh and a partition; free sides have no multiplier."""
    cells = np.flatnonzero(~np.isin(partition.side, free))
    B = coupling(condensed.mesh, partition)[cells]
    operator = replace(dual_operator(condensed, partition, B), H_i=partition.lengths[cells])
    return Pair(partition, B, operator, cells)


def guarded_beta(both: Pair, sigma_1: float) -> float:
    """What serves as beta where no Gram matrix is at hand: ||e||_{-1/2} <= sigma_1^{-1/2} ||e||_0."""
    return math.sqrt(STEKLOV_GUARD * sigma_1 * max(both.operator.lambda_min, 0.0))


def solve(problem: OnMesh, cells: OnCells, both: Pair, beta: float, stop: Stop = Stop()) -> Solution:
    """The solution (u_h, lambda_H) of (P_h*) for a case, and its errors.

    `beta` is a lower bound of the constant in (3.4), which turns the algebraic bound into one in H^{-1/2}.
    """
    offset = both.offset(problem.trace, cells.g_means)
    tolerance = _tolerance(problem, cells, both.operator, stop)
    result = iterate(both.operator, offset, tolerance, stop, None)
    singular = both.operator.singular
    if stop.tolerance is None and result.converged and not singular and not cells.lambda_is_zero:
        error = problem.discrete_dual(problem.flux_load - both.B.T @ result.lambda_H)
        needed = stop.fraction * error * beta
        if result.bound > needed:
            going_on = replace(stop, algorithm="nesterov") if result.algorithm == "nesterov" else stop
            result = joined(result, iterate(both.operator, offset, needed, going_on, result.lambda_H))
            tolerance = needed
    return _measured(problem, cells, both, result, tolerance)


def _tolerance(problem: OnMesh, cells: OnCells, operator: DualOperator, stop: Stop) -> float:
    if stop.tolerance is not None:
        return stop.tolerance
    if operator.singular or cells.lambda_is_zero:
        return stop.fraction * problem.ritz_error
    of_lambda = math.sqrt(operator.lambda_min) * cells.projection_error
    return stop.fraction * min(x for x in (problem.ritz_error, of_lambda) if x > 0)


def iterate(
    operator: DualOperator, offset: Array, tolerance: float, stop: Stop, start: Array | None
) -> DualResult:
    """lambda_H (m,) for the offset F(0) (m,), by the algorithm that `stop` asks for."""
    algorithm = stop.algorithm
    if len(offset) == 0:
        return DualResult(np.zeros(0), 0, 0, 0.0, True, math.nan, "direct")
    if algorithm == "auto" and operator.singular:
        if stop.rho is not None:
            raise InputError(
                "rho has no use where S is singular (h/H too large); leave it out, or take smaller h"
            )
        algorithm = "active_set"
    elif algorithm == "auto":
        algorithm = _plain_or_faster(operator, offset, tolerance, stop, start)
    if algorithm == "active_set":
        return active_set(operator, offset, tolerance)
    return uzawa(operator, offset, tolerance, stop.rho, start, stop.max_steps, algorithm)


def _plain_or_faster(
    operator: DualOperator, offset: Array, tolerance: float, stop: Stop, start: Array | None
) -> str:
    if stop.rho is not None:
        return "uzawa"
    rho = 1.9 / operator.lambda_max
    with np.errstate(over="ignore", invalid="ignore"):
        first = residual_bound(operator, offset, np.zeros(len(offset)) if start is None else start, rho)
    return "uzawa" if predicted_steps(operator, rho, first, tolerance) <= stop.max_steps else "nesterov"


def joined(first: DualResult, second: DualResult) -> DualResult:
    """The second run, which went on where the first one ended, with the counts of both."""
    return replace(
        second,
        iterations=first.iterations + second.iterations,
        operator_applications=first.operator_applications + second.operator_applications,
    )


def _measured(problem: OnMesh, cells: OnCells, both: Pair, result: DualResult, tolerance: float) -> Solution:
    condensed, lambda_H = problem.condensed, both.extended(result.lambda_H)
    difference = problem.flux_load - both.B.T @ result.lambda_H
    h1_error, share = problem.h1_error(difference)
    u_h = response(condensed, both, problem.load, result.lambda_H)
    integral = condensed.mesh.areas @ u_h[condensed.mesh.triangles].mean(axis=1)
    judged = not both.operator.singular
    return Solution(
        result,
        lambda_H,
        tolerance,
        u_h,
        h1_error=h1_error,
        hm12_discrete=problem.discrete_dual(difference) if judged else math.nan,
        l2_error=cells.l2_error(lambda_H) if judged else math.nan,
        quadrature_share=share,
        balance=float(abs(integral - problem.load.sum() - cells.partition.lengths @ lambda_H)),
    )


def response(condensed: Condensed, both: Pair, load: Array, mu: Array) -> Array:
    """u(mu) (n,) of (5.1), for the values (f, phi_i) (n,) and mu (m,) on the cells that are not free."""
    total = load.copy()
    total[condensed.mesh.boundary] += both.B.T @ mu
    return condensed.solve(total)
