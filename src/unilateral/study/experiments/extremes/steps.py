"""Axes of the step rho, over its limit 2/lambda_max(S), as (5.1), (5.2) are meant and as they are printed."""

from __future__ import annotations

from functools import partial

import numpy as np

from unilateral.solvers.uzawa import DualResult, residual_bound
from unilateral.study.experiments.extremes.outcome import Axis, Budget, Row, judge, untooled
from unilateral.study.experiments.extremes.problem import Array, ExtremeProblem, full, on_square, waves
from unilateral.study.experiments.extremes.trial import attempt
from unilateral.study.uzawa_variants import VARIANTS, iterate


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
        return problem.error(_last(problem, share, budget, VARIANTS[0])) / problem.size

    return [
        attempt(share, lambda _: problem, budget, partial(left, share), share=share)
        for share in values.tolist()
    ]


def _as_printed(values: Array, problem: ExtremeProblem, budget: Budget) -> list[Row]:
    """The rows by the iteration itself, with the bound and the relative error of its last iterate."""
    operator, tolerance, rows = problem.spaces.operator, budget.tolerance(problem), []
    for share in values.tolist():
        rho, mu = share * 2 / operator.lambda_max, _last(problem, share, budget, VARIANTS[1])
        bound = residual_bound(operator, problem.discrete.offset, mu, rho)
        result = DualResult(mu, budget.max_steps, 0, bound, bound <= tolerance, rho, VARIANTS[1])
        found = judge(problem, result, tolerance)
        rows.append(untooled(share, found, found.true_error / problem.size))
    return rows


def _last(problem: ExtremeProblem, share: float, budget: Budget, variant: str) -> Array:
    operator = problem.spaces.operator
    rho = share * 2 / operator.lambda_max
    return iterate(operator, problem.discrete.offset, rho, budget.max_steps, variant)
