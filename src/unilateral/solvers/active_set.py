"""An active-set solver of the same discrete problem, independent of Uzawa and of lambda_min(S) > 0.

With y = R (u_h - A^{-1} f) on the boundary, A_3 = R^T R, the discrete problem is the least-distance problem
min |y|^2 subject to D_factor^T y >= -H_i F(0), whose multipliers are lambda_H. Lawson and Hanson (Solving
Least Squares Problems, 1974, chapter 23) reduce it to one non-negative least-squares problem, which an
active-set method solves in finitely many steps, whatever the rank of D.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg.blas import dnrm2

from unilateral.arrays import Array
from unilateral.fem.spaces import DualOperator
from unilateral.solvers.uzawa import (
    DualResult,
    check_offset,
    energy_bound,
    residual_bound,
    warn_of_missed_tolerance,
)


def solve_by_active_set(operator: DualOperator, offset: Array, tolerance: float) -> DualResult:
    """lambda_H (m,) for the offset F(0) (m,), with its bound; one of several where it is not unique.

    The bound is `residual_bound`, or `energy_bound` where S is singular. If it exceeds `tolerance`, the
    result warns and has converged False. If the solver gives up, lambda_H is 0, with the bound of that.
    """
    check_offset(offset, tolerance)
    try:
        lambda_H = _solve_least_distance(operator, offset)
    except RuntimeError:
        lambda_H = np.full(len(offset), math.nan)
    if not np.all((lambda_H >= 0) & np.isfinite(lambda_H)):
        lambda_H = np.zeros(len(offset))
    # S is applied for the gap, and in `residual_bound` for ||R||_S, too
    if operator.is_singular:
        bound = energy_bound(operator, offset, lambda_H)
        applications = 1
    else:
        bound = residual_bound(operator, offset, lambda_H, 1 / operator.lambda_max)
        applications = 2
    result = DualResult(
        lambda_H,
        iterations=math.nan,
        operator_applications=applications,
        bound=bound,
        converged=bound <= tolerance,
        rho=math.nan,
        algorithm="active_set",
    )
    warn_of_missed_tolerance(result, tolerance)
    return result


def _solve_least_distance(operator: DualOperator, offset: Array) -> Array:
    """lambda_H (m,), negative or not finite where the last residual, 1 / (1 + |y|^2), rounds to 0."""
    # the offset is scaled so that the residual stays away from 0, except on domains much larger than 1
    from scipy.optimize import nnls

    # the vector h = -H_i F(0) / scale is the matrix's last row. The x >= 0 of least
    # |D_factor x|^2 + (h . x - 1)^2 gives lambda_H = scale x / (1 - h . x); 1 - h . x = 1 / (1 + |y|^2)
    scale = dnrm2(np.sqrt(operator.H_i) * np.minimum(offset, 0))
    if scale == 0:
        return np.zeros(len(offset))
    matrix = np.vstack([operator.D_factor, -operator.H_i * offset / scale])
    target = np.append(np.zeros(len(operator.D_factor)), 1.0)
    solution, _ = nnls(matrix, target, maxiter=10 * matrix.shape[1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.asarray(scale * solution / (1 - matrix[-1] @ solution))
