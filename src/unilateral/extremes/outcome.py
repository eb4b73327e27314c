"""What became of a problem: right, not converged with a valid bound, refused, or wrong."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from unilateral.acceleration import STEPS
from unilateral.active_set import active_set
from unilateral.errors import InputError
from unilateral.extremes.problem import Array, Problem
from unilateral.solve import Stop, iterate
from unilateral.uzawa import DualResult, uzawa

RIGHT, NOT_CONVERGED, REFUSED, WRONG = OUTCOMES = ("right", "not converged", "refused", "wrong")
NO_TOOL = ""
"""The library offers no such thing."""
Measure = Callable[[Problem, Array], float]
"""A number of a problem and the active set's lambda_H (m,)."""
NOTHING = np.inf
"""The limit on an axis with falling values where plain Uzawa is promised nothing."""


@dataclass(frozen=True)
class Verdict:
    """What a result is, by ||u(mu) - u_h||_1, the bound that it tells, and what is allowed for rounding."""

    outcome: str
    error: float
    bound: float
    allowance: float

    @property
    def used(self) -> float:
        """The share of the bound that the error takes; a wrong result takes it all."""
        allowed = self.bound + self.allowance
        if self.outcome == WRONG:
            return np.inf
        return self.error / allowed if 0 < allowed < np.inf else 0.0


@dataclass(frozen=True)
class Row:
    """A point of an axis: the outcomes of plain Uzawa and of the tool's choice, a number, its prediction.

    `true_error`, `guaranteed` (its bound) and `allowance` are those of the algorithm that is nearest to its
    bound, or beyond it.
    """

    value: float
    outcome: str
    tool: str
    true_error: float = np.nan
    guaranteed: float = np.nan
    allowance: float = np.nan
    measured: float = np.nan
    predicted: float = np.nan
    message: str = ""


@dataclass(frozen=True)
class Axis:
    """The rows, and up to where plain Uzawa and the tool are predicted to be right; NaN: everywhere.

    `local_limit` is up to where plain Uzawa converges from nearby; NaN where that is not asked for.
    """

    rows: list[Row]
    limit: float = np.nan
    tool_limit: float = np.nan
    local_limit: float = np.nan


@dataclass(frozen=True)
class Budget:
    """The tolerance, relative to a problem's size, and the steps of a run."""

    accuracy: float
    max_steps: int

    @property
    def condition(self) -> float:
        """The condition number of S up to which plain Uzawa needs no more steps, rho = 1.9/lambda_max(S)."""
        return 1.9 * self.max_steps / -np.log(self.accuracy)

    @property
    def accelerated(self) -> float:
        """The same for Nesterov, with a contraction of 1 - cond(S)^{-1/2}."""
        return float((self.max_steps / np.log(self.accuracy)) ** 2)


def judge(problem: Problem, result: DualResult, tolerance: float) -> Verdict:
    """By the true error; a result that says more than is true is wrong, whatever its error."""
    error = problem.error(result.lambda_H)
    allowance = problem.rounding * max(problem.size, problem.norm(problem.u))
    outcome = RIGHT if result.converged else NOT_CONVERGED
    if not error <= result.bound + allowance or result.converged != (result.bound <= tolerance):
        outcome = WRONG
    return Verdict(outcome, error, result.bound, allowance)


def attempt(
    value: float,
    make: Callable[[float], Problem],
    budget: Budget,
    measure: Measure,
    start: float | Array = 0.0,
    share: float | None = None,
) -> Row:
    """Plain Uzawa from `start` on every cell, rho a share of 2/lambda_max(S); and all other algorithms.

    Any wrong result makes the point wrong; only an InputError counts as refused. With a share there is no
    outcome of the tool, which takes rho as it is given.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            problem = make(value)
        except InputError as error:
            return Row(value, REFUSED, REFUSED, message=str(error))
        operator, offset = problem.both.operator, problem.offset
        tolerance = budget.accuracy * (problem.size or 1.0)
        rho = None if share is None else share * 2 / operator.lambda_max
        begin = np.full(len(offset), start)
        plain = uzawa(operator, offset, tolerance, rho, begin, budget.max_steps)
        exact = active_set(operator, offset, tolerance)
        others = [
            uzawa(operator, offset, tolerance, None, begin, budget.max_steps, method)
            for method in STEPS
            if method != plain.algorithm and not (method == "newton" and operator.singular)
        ]
        chosen = iterate(operator, offset, tolerance, Stop(max_steps=budget.max_steps), begin)
        found = {each.algorithm: judge(problem, each, tolerance) for each in (plain, exact, *others)}
        tool = judge(problem, chosen, tolerance)
        number = measure(problem, exact.lambda_H)
    worst = max((*found.values(), tool), key=lambda each: each.used)
    row = Row(value, found[plain.algorithm].outcome, tool.outcome, *_numbers(worst), number)
    if worst.outcome == WRONG:
        names = [name for name, each in found.items() if each.outcome == WRONG] or ["the tool"]
        said = f"{', '.join(names)}: the error is above the bound"
        return replace(row, outcome=WRONG, tool=WRONG, message=said)
    return replace(row, tool=row.tool if share is None else NO_TOOL, message=_said(plain, tolerance))


def untooled(value: float, verdict: Verdict, measured: float, predicted: float = np.nan) -> Row:
    """The row of an algorithm that the library does not offer."""
    said = f"bound {verdict.bound:.2g}"
    return Row(value, verdict.outcome, NO_TOOL, *_numbers(verdict), measured, predicted, said)


def _numbers(verdict: Verdict) -> tuple[float, float, float]:
    return verdict.error, verdict.bound, verdict.allowance


def attempts(
    values: Array,
    make: Callable[[float], Problem],
    budget: Budget,
    measure: Measure,
    start: float = 0.0,
) -> list[Row]:
    """An attempt for every value, from mild to extreme."""
    return [attempt(value, make, budget, measure, start) for value in values.tolist()]


def _said(result: DualResult, tolerance: float) -> str:
    if result.converged:
        return f"{result.iterations} steps"
    return f"bound {result.bound / tolerance:.2g} times the tolerance after {result.iterations} steps"


def predicted(rows: Sequence[Row], values: Array) -> list[Row]:
    """The rows with what is predicted of their numbers."""
    return [replace(row, predicted=float(value)) for row, value in zip(rows, values, strict=True)]


def within(rows: Sequence[Row], slack: float) -> list[Row]:
    """The rows, wrong where the number is above `slack` and above what is predicted."""
    return [
        replace(row, outcome=WRONG, tool=WRONG, message=f"{row.measured:.2g}, predicted {row.predicted:.2g}")
        if row.outcome != REFUSED and not row.measured <= max(row.predicted, slack)
        else row
        for row in rows
    ]


def crossing(values: Array, numbers: Array, limit: float) -> float:
    """The value, on logarithmic scales, where the numbers first pass the limit; NaN if they do not."""
    x, y = np.log(values), np.log(numbers)
    above = np.flatnonzero(y > np.log(limit))
    if not above.size or above[0] == 0:
        return np.nan
    k = above[0]
    if not np.isfinite(y[k]):
        return float(values[k])
    return float(np.exp(x[k - 1] + (np.log(limit) - y[k - 1]) * (x[k] - x[k - 1]) / (y[k] - y[k - 1])))
