"""Axes of the step rho, over its limit 2/lambda_max(S), as (5.1), (5.2) are meant and as they are printed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from unilateral.solvers.uzawa import DualResult, residual_bound
from unilateral.study.runs.algorithm import VARIANTS, iterate
from unilateral.study.runs.extremes.outcome import Axis, Budget, Row, judge, untooled
from unilateral.study.runs.extremes.problem import Array, Problem, full, on_square, waves
from unilateral.study.runs.extremes.trial import attempt


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
    """The same in partial contact; the half is proved as long as the clip is not active."""
    problem = on_square(h, H, waves)
    return Axis(_as_printed(values, problem, budget), 0.5, local_limit=0.5 * local_limit(problem))


def local_limit(problem: Problem) -> float:
    """lambda_max of S over that on the held cells, which alone decide once no other cell is loaded again."""
    held = np.flatnonzero(problem.lambda_H)
    S = problem.spaces.operator.S
    return problem.spaces.operator.lambda_max / float(np.linalg.eigvalsh(S[np.ix_(held, held)])[-1])


def _as_meant(values: Array, problem: Problem, budget: Budget) -> list[Row]:
    """The number is the error that is left after all steps, relative."""

    def left(share: float) -> float:
        rho = share * 2 / problem.spaces.operator.lambda_max
        mu = iterate(problem.spaces.operator, problem.discrete.offset, rho, budget.max_steps, VARIANTS[0])
        return problem.error(mu) / problem.size

    rows = [
        attempt(share, lambda _: problem, budget, lambda of, _: of.size, share=share)
        for share in values.tolist()
    ]
    return [replace(row, measured=left(row.value)) for row in rows]


def _as_printed(values: Array, problem: Problem, budget: Budget) -> list[Row]:
    """Only the iteration itself, with the bound of its last iterate."""
    operator, rows = problem.spaces.operator, []
    tolerance = budget.tolerance(problem)
    for share in values.tolist():
        rho = share * 2 / operator.lambda_max
        mu = iterate(operator, problem.discrete.offset, rho, budget.max_steps, VARIANTS[1])
        bound = residual_bound(operator, problem.discrete.offset, mu, rho)
        result = DualResult(mu, budget.max_steps, 0, bound, bound <= tolerance, rho, VARIANTS[1])
        found = judge(problem, result, tolerance)
        left = problem.error(mu) / problem.size
        rows.append(untooled(share, found, left))
    return rows
