"""Runs the iteration for lambda_H by the algorithm that is asked for."""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.spaces import DualOperator
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult, predicted_steps, residual_bound, uzawa
from unilateral.solvers.uzawa_steps import UZAWA_STEP_FACTOR


def run_algorithm(
    operator: DualOperator, offset: Array, tolerance: float, stop: Stop, start: Array | None
) -> DualResult:
    """lambda_H (m,) for the offset F(0) (m,), by the algorithm that `stop` asks for."""
    algorithm = stop.algorithm
    if len(offset) == 0:
        return DualResult(np.zeros(0), 0, 0, bound=0.0, converged=True, rho=math.nan, algorithm="direct")
    if algorithm == "auto" and operator.is_singular:
        if stop.rho is not None:
            raise InputError(
                "rho cannot be used if S is singular (h/H too large); leave rho out, or take a smaller h"
            )
        algorithm = "active_set"
    elif algorithm == "auto":
        algorithm = _choose_algorithm(operator, offset, tolerance, stop, start)
    _check_rho(operator, algorithm, stop.rho)
    if algorithm == "active_set":
        return solve_by_active_set(operator, offset, tolerance)
    return uzawa(
        operator, offset, tolerance, rho=stop.rho, start=start, max_steps=stop.max_steps, method=algorithm
    )


def _check_rho(operator: DualOperator, algorithm: str, rho: float | None) -> None:
    """Raises InputError for a rho with which the steps need not converge, and may take all of max_steps."""
    # Uzawa's steps y - rho (S y + b) are contractions for rho < 2/lambda_max(S) (5.2). Nesterov's momentum is
    # proved to converge for rho <= 1/lambda_max(S). The others only begin with rho
    factor = {"uzawa": 2.0, "nesterov": 1.0}.get(algorithm, math.inf)
    if rho is None or rho * operator.lambda_max < factor or (rho * operator.lambda_max == factor == 1.0):
        return
    limit = factor / operator.lambda_max
    raise InputError(
        f"rho = {rho:g} is too large: steps of the algorithm {algorithm} are sure to converge for rho below "
        f"{factor:g} / lambda_max(S) = {limit:.4g}; take a smaller one, or leave rho out"
    )


def _choose_algorithm(
    operator: DualOperator, offset: Array, tolerance: float, stop: Stop, start: Array | None
) -> str:
    """Plain Uzawa where rho is given or it is predicted to end within max_steps, else Nesterov."""
    if stop.rho is not None:
        return "uzawa"
    rho = UZAWA_STEP_FACTOR / operator.lambda_max
    with np.errstate(over="ignore", invalid="ignore"):
        first = residual_bound(operator, offset, np.zeros(len(offset)) if start is None else start, rho)
    return "uzawa" if predicted_steps(operator, rho, first, tolerance) <= stop.max_steps else "nesterov"
