"""Axes of the step rho, over 2/lambda_max(S), as (5.1), (5.2) are meant and as they are printed.

In full contact the limit is 1: above it the clip leaves a bounded cycle. In contact on three intervals 1 is
proved to be safe; larger steps may do. With the printed index z^2 - z + rho sigma = 0 halves the range, in
partial contact as long as the clip is not active. The number is the error left after all steps, relative.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from unilateral.solvers.uzawa import DualResult, residual_bound
from unilateral.study.runs.algorithm import VARIANTS, iterate
from unilateral.study.runs.extremes.outcome import Axis, Budget, Row, judge, untooled
from unilateral.study.runs.extremes.problem import Array, Contact, Problem, full, on_square, waves
from unilateral.study.runs.extremes.trial import attempt


def step_full(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """rho over its limit, in full contact."""
    return _as_meant(values, h, H, budget, full)


def step_partial(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """rho over its limit, in partial contact."""
    return _as_meant(values, h, H, budget, waves)


def printed_full(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The same for the index as printed, in full contact."""
    return _as_printed(values, h, H, budget, full)


def printed_partial(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The same for the index as printed, in partial contact."""
    return _as_printed(values, h, H, budget, waves)


def _as_meant(values: Array, h: float, H: float, budget: Budget, contact: Contact) -> Axis:
    """By every algorithm that the library offers."""
    problem = on_square(h, H, contact)

    def left(share: float, *_: object) -> float:
        mu = _last(problem, share * 2 / problem.spaces.operator.lambda_max, budget, VARIANTS[0])
        return problem.error(mu) / problem.size

    rows = [
        attempt(share, lambda _: problem, budget, partial(left, share), share=share)
        for share in values.tolist()
    ]
    return Axis(rows, 1.0, local_limit=local_limit(problem))


def _as_printed(values: Array, h: float, H: float, budget: Budget, contact: Contact) -> Axis:
    """By the iteration itself, with the bound of its last iterate."""
    problem = on_square(h, H, contact)
    operator, offset, tolerance = problem.spaces.operator, problem.discrete.offset, budget.tolerance(problem)

    def tried(share: float) -> Row:
        rho = share * 2 / operator.lambda_max
        mu = _last(problem, rho, budget, VARIANTS[1])
        bound = residual_bound(operator, offset, mu, rho)
        result = DualResult(mu, budget.max_steps, 0, bound, bound <= tolerance, rho, VARIANTS[1])
        return untooled(share, judge(problem, result, tolerance), problem.error(mu) / problem.size)

    return Axis(list(map(tried, values.tolist())), 0.5, local_limit=0.5 * local_limit(problem))


def local_limit(problem: Problem) -> float:
    """lambda_max of S over that on the held cells, which alone decide once no other cell is loaded again.

    NaN in full contact, where it is the limit itself.
    """
    held, S = np.flatnonzero(problem.lambda_H), problem.spaces.operator.S
    if len(held) == len(S):
        return np.nan
    return problem.spaces.operator.lambda_max / float(np.linalg.eigvalsh(S[np.ix_(held, held)])[-1])


def _last(problem: Problem, rho: float, budget: Budget, variant: str) -> Array:
    return iterate(problem.spaces.operator, problem.discrete.offset, rho, budget.max_steps, variant)
