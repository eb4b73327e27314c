"""Axes of the precision: float32, and float64, from the factors of A on, until round-off stops the iteration.

A is assembled, and F(0) computed, in float64, and then rounded. With S y + b known to epsilon ||b||, epsilon
the unit round-off, iterates stay about epsilon cond(S) ||y|| from lambda_H in L2. S is not known as well as
that: it comes from the factors of A, and their rounding is seen on top.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import DTypeLike
from scipy.linalg import solve_triangular

from unilateral.fem.linear_systems import elimination_order, factorise, last_block
from unilateral.fem.spaces import DualOperator
from unilateral.solvers.uzawa import DualResult, residual_bound
from unilateral.study.experiments.extremes.outcome import Axis, Budget, crossing, judge, untooled
from unilateral.study.experiments.extremes.problem import Array, ExtremeProblem, full, on_square


def single(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The axis is H, h in proportion; the number is the floor of lambda's relative L2 error in float32."""
    return _floors(values, h / H, budget, np.float32)


def double(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The same as `single`, in float64."""
    return _floors(values, h / H, budget, np.float64)


def _floors(values: Array, h_over_H: float, budget: Budget, precision: DTypeLike) -> Axis:
    """The axis of a precision, judged by the bound in float64.

    Predicted are the floor epsilon cond(S), in L2, and the limit by the bound there.
    """
    rows, bounds, unit_roundoff = [], [], 0.5 * float(np.finfo(precision).eps)
    for size in values.tolist():
        problem = on_square(h_over_H * size, size, full)
        of, tolerance = problem.spaces.operator, budget.tolerance(problem)
        mu = _last(problem, operator_in(problem, precision), budget.max_steps)
        bound = residual_bound(of, problem.discrete.offset, mu, 1 / of.lambda_max)
        result = DualResult(mu, budget.max_steps, 0, bound, bound <= tolerance, np.nan, "uzawa")
        found, floor = judge(problem, result, tolerance), unit_roundoff * problem.condition
        rows.append(untooled(size, found, problem.distance(mu, problem.lambda_H), floor))
        bounds.append(floor * _bound_of_floor(problem))
    return Axis(rows, crossing(values, np.array(bounds), budget.accuracy))


def operator_in(problem: ExtremeProblem, precision: DTypeLike) -> DualOperator:
    """The dual operator of A rounded to that precision, its factors, A_3, D and S computed in it."""
    spaces, mesh = problem.spaces, problem.spaces.mesh
    A = spaces.condensed.A.astype(precision)
    cholesky = last_block(factorise(A, elimination_order(A, mesh.boundary)), len(mesh.boundary))
    half = solve_triangular(cholesky, spaces.B.T.toarray().astype(precision), trans="T")
    return DualOperator(half, spaces.partition.lengths.astype(precision), mesh.polygon.area)


def _bound_of_floor(problem: ExtremeProblem) -> float:
    """How large the bound with rho = 1/lambda_max(S) may be, over `size`, per relative error e in L2.

    In full contact R = rho S e, so ||R||_0 <= ||e||_0 and ||R||_S <= lambda_max^(1/2) ||e||_0.
    """
    of = problem.spaces.operator
    in_L2 = float(np.sqrt(of.H_i @ problem.lambda_H**2))
    return float(np.sqrt(of.lambda_max) * (1 + np.sqrt(problem.condition))) * in_L2 / problem.size


def _last(problem: ExtremeProblem, operator: DualOperator, steps: int) -> Array:
    """Uzawa's last iterate lambda (m,), every operation in the operator's precision."""
    root = np.sqrt(operator.H_i)
    S, b = operator.S, (root * problem.discrete.offset).astype(root.dtype)
    rho = root.dtype.type(1.9 / operator.lambda_max)
    y = np.zeros_like(b)
    for _ in range(steps):
        y = np.maximum(0, y - rho * (S @ y + b))
    return np.asarray(y / root, dtype=float)
