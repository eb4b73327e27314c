"""Axes of the iteration itself: its step rho and its precision.

The step is taken over its limit 2/lambda_max(S), as (5.1), (5.2) are meant and as they are printed.

The precision is float32 or float64, from the factors of A on, until round-off stops the iteration: A is
assembled, and F(0) computed, in float64, and then rounded. With S y + b known to epsilon ||b||, epsilon the
unit round-off, iterates stay about epsilon cond(S) ||y|| from lambda_H in L2. S is not known as well as that:
it comes from the factors of A, and their rounding is seen on top.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import DTypeLike
from scipy.linalg import solve_triangular

from study.experiments.extremes.outcome import (
    NO_TOOL,
    Axis,
    Budget,
    Row,
    Verdict,
    attempt,
    crossing,
    judge,
)
from study.experiments.extremes.problem import ExtremeProblem, full, on_square, waves
from study.uzawa_variants import VARIANTS, iterate
from unilateral.arrays import Array
from unilateral.fem.linear_systems import elimination_order, factorise, last_block
from unilateral.fem.spaces import DualOperator
from unilateral.solvers.uzawa import DualResult, residual_bound


def step_full(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Full contact, where 1 is the limit: above it the clip leaves a bounded cycle."""
    return Axis(_as_meant(values, on_square(h, H, full), budget), 1.0)


def step_partial(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Contact on three intervals, where 1 is proved to be safe; larger steps may do."""
    problem = on_square(h, H, waves)
    return Axis(_as_meant(values, problem, budget), 1.0, local_limit=local_limit(problem))


def printed_full(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Full contact with the printed index: z^2 - z + rho sigma = 0 halves the range."""
    return Axis(_as_printed(values, on_square(h, H, full), budget), 0.5)


def printed_partial(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Contact on three intervals, printed index; the half is proved as long as the clip is not active."""
    problem = on_square(h, H, waves)
    return Axis(_as_printed(values, problem, budget), 0.5, local_limit=0.5 * local_limit(problem))


def local_limit(problem: ExtremeProblem) -> float:
    """lambda_max of S over lambda_max of S on the held cells.

    The held cells alone decide once no other cell is loaded again.
    """
    held, S = np.flatnonzero(problem.lambda_H), problem.spaces.operator.S
    return problem.spaces.operator.lambda_max / float(np.linalg.eigvalsh(S[np.ix_(held, held)])[-1])


def _as_meant(values: Array, problem: ExtremeProblem, budget: Budget) -> list[Row]:
    """The rows by every algorithm; the number is the relative error left by plain Uzawa after all steps."""

    def left(share: float, *_: object) -> float:
        return problem.error(_iterate(problem, share, budget, VARIANTS[0])) / problem.size

    return [
        attempt(share, lambda _: problem, budget, partial(left, share), share=share)
        for share in values.tolist()
    ]


def _as_printed(values: Array, problem: ExtremeProblem, budget: Budget) -> list[Row]:
    """The rows by the iteration itself, with the bound and the relative error of its last iterate."""
    rows = []
    for share in values.tolist():
        verdict = _by_bound(problem, _iterate(problem, share, budget, VARIANTS[1]), share, budget)
        rows.append(_untooled(share, verdict, verdict.true_error / problem.size))
    return rows


def _iterate(problem: ExtremeProblem, share: float, budget: Budget, variant: str) -> Array:
    """Uzawa's last iterate lambda (m,), with rho that share of 2/lambda_max(S)."""
    operator = problem.spaces.operator
    rho = share * 2 / operator.lambda_max
    return iterate(operator, problem.discrete.offset, rho, budget.max_steps, variant)


def _by_bound(problem: ExtremeProblem, mu: Array, share: float, budget: Budget) -> Verdict:
    """The verdict on a last iterate, by the bound of the residual with that share of 2/lambda_max(S)."""
    operator, tolerance = problem.spaces.operator, budget.tolerance(problem)
    rho = share * 2 / operator.lambda_max
    bound = residual_bound(operator, problem.discrete.offset, mu, rho)
    result = DualResult(mu, budget.max_steps, 0, bound, bound <= tolerance, rho, "uzawa")
    return judge(problem, result, tolerance)


def _untooled(value: float, verdict: Verdict, measured: float, predicted: float = np.nan) -> Row:
    """The row of an iteration that the library does not offer."""
    said = f"bound {verdict.guaranteed:.2g}"
    return Row(value, verdict.outcome, NO_TOOL, measured, predicted, said, **verdict.numbers)


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
        mu = _iterate_in(problem, operator_in(problem, precision), budget.max_steps)
        floor, distance = unit_roundoff * problem.condition, problem.distance(mu, problem.lambda_H)
        rows.append(_untooled(size, _by_bound(problem, mu, 0.5, budget), distance, floor))
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


def _iterate_in(problem: ExtremeProblem, operator: DualOperator, steps: int) -> Array:
    """Uzawa's last iterate lambda (m,), every operation in the operator's precision."""
    root = np.sqrt(operator.H_i)
    S, b = operator.S, (root * problem.discrete.offset).astype(root.dtype)
    rho = root.dtype.type(1.9 / operator.lambda_max)
    y = np.zeros_like(b)
    for _ in range(steps):
        y = np.maximum(0, y - rho * (S @ y + b))
    return np.asarray(y / root, dtype=float)
