"""What becomes of a problem: right, not converged with a valid bound, refused, or wrong.

It is tried by every algorithm that the library offers, and by the one that the library takes itself.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from study.experiments.extremes.problem import ExtremeProblem
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.solvers.active_set import solve_by_active_set
from unilateral.solvers.dispatch import run_algorithm
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult, uzawa
from unilateral.solvers.uzawa_steps import STEP_METHODS, UZAWA_STEP_FACTOR

OUTCOME_RIGHT = "right"
OUTCOME_NOT_CONVERGED = "not converged"
OUTCOME_REFUSED = "refused"
OUTCOME_WRONG = "wrong"
OUTCOME_NO_TOOL = ""
"""The outcome of the library's own choice where the library offers no such thing."""
NEVER_RIGHT = np.inf
"""The limit on an axis with falling values where nothing is predicted to be right by plain Uzawa."""
PLAIN_UZAWA = "uzawa"
ACTIVE_SET = "active_set"
LIBRARY_CHOICE = "the tool"


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Problems from mild to extreme, how each is tried, and what is predicted of them.

    All functions are given the value on the axis. `measure` makes a number from the problem and the active
    set's lambda_H (m,), and `start` gives lambda^0, on every cell or (m,). Where the axis `sets_rho`, its
    values are rho over 2/lambda_max(S). `run` is an iteration that the library does not offer: it alone is
    judged then, and its last lambda is measured in the place of the active set's.

    The number of each value is predicted to be `predicted`, NaN if nothing is; with a `max_change` it is
    wrong above both. Up to `limit` plain Uzawa is predicted to be right, up to `tool_limit` the library's
    choice; NaN stands for everywhere. Up to `local_limit` plain Uzawa converges from nearby; it is NaN where
    that is not asked for.
    """

    pose: Callable[[float], ExtremeProblem]
    measure: Callable[[float, ExtremeProblem, Array], float]
    start: Callable[[float, ExtremeProblem], float | Array] = lambda value, problem: 0.0
    sets_rho: bool = False
    run: Callable[[float, ExtremeProblem], DualResult] | None = None
    predicted: float | Array = np.nan
    max_change: float | None = None
    limit: float = np.nan
    tool_limit: float = np.nan
    local_limit: float = np.nan


@dataclass(frozen=True)
class Budget:
    """The tolerance, relative to a problem's size, and the steps of a run."""

    accuracy: float
    max_steps: int

    def tolerance(self, problem: ExtremeProblem) -> float:
        """The tolerance in ||.||_{-1/2,h}; relative to 1 where lambda_H is 0."""
        return self.accuracy * (problem.size or 1.0)

    @property
    def max_condition(self) -> float:
        """The largest cond(S) for which plain Uzawa needs no more steps, with rho = 1.9/lambda_max(S)."""
        # An error falls like (1 - 1.9/cond)^n: n = cond log(1/accuracy) / 1.9
        return UZAWA_STEP_FACTOR * self.max_steps / -np.log(self.accuracy)

    @property
    def max_condition_nesterov(self) -> float:
        """The largest cond(S) for which Nesterov needs no more steps, contracting by 1 - cond(S)^{-1/2}."""
        # An error falls like (1 - cond^{-1/2})^n: n = cond^{1/2} log(1/accuracy)
        return float((self.max_steps / np.log(self.accuracy)) ** 2)


@dataclass(frozen=True, eq=False)
class RunVerdict:
    """The outcome of a run; what is said of it; its algorithm and lambda_H (m,), if it was not refused.

    Its numbers are the error ||u(mu) - u_h||_1, the bound that is told, the allowance for rounding, the
    tolerance, and ||u_h||_1; all are NaN for what is refused.
    """

    outcome: str
    message: str
    algorithm: str = ""
    lambda_H: Array | None = None
    true_error: float = np.nan
    guaranteed: float = np.nan
    allowance: float = np.nan
    tolerance: float = np.nan
    u_norm: float = np.nan

    @property
    def bound_share(self) -> float:
        """The share of the bound that the error takes; all of it if wrong, less than any other if refused."""
        if self.outcome in (OUTCOME_WRONG, OUTCOME_REFUSED):
            return np.inf if self.outcome == OUTCOME_WRONG else -1.0
        allowed = self.guaranteed + self.allowance
        return self.true_error / allowed if allowed > 0 else 0.0


def try_value(axis: Axis, value: float, predicted: float, budget: Budget) -> dict[str, Any]:
    """The point of a value on its axis, by the names of the table's variables."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            problem = axis.pose(value)
        except InputError as error:
            point = _tabulate_verdict(RunVerdict(OUTCOME_REFUSED, str(error)), OUTCOME_REFUSED, np.nan)
        else:
            if axis.run is None:
                point = _try_algorithms(axis, value, problem, budget)
            else:
                result = axis.run(value, problem)
                verdict = judge_run(problem, result, budget.tolerance(problem))
                measured = axis.measure(value, problem, result.lambda_H)
                point = _tabulate_verdict(
                    verdict, OUTCOME_NO_TOOL, measured, message=f"bound {result.bound:.2g}"
                )
    point |= {"value": value, "predicted": predicted}
    measured = point["measured"]
    # A number is wrong above both its prediction and `max_change`
    untried = point["outcome"] == OUTCOME_REFUSED and np.isnan(measured)
    if axis.max_change is not None and not untried and not measured <= max(predicted, axis.max_change):
        message = f"{measured:.2g}, predicted {predicted:.2g}"
        point |= {"outcome": OUTCOME_WRONG, "tool": OUTCOME_WRONG, "message": message}
    return point


def _tabulate_verdict(verdict: RunVerdict, tool: str, measured: float, **overrides: str) -> dict[str, Any]:
    """A point with the verdict's numbers, and its outcome and message unless there are others."""
    names = ("true_error", "guaranteed", "allowance", "tolerance", "u_norm")
    numbers = {name: getattr(verdict, name) for name in names}
    outcome = {"outcome": verdict.outcome, "tool": tool, "message": verdict.message}
    return {**numbers, "measured": measured, **outcome, **overrides}


def _try_algorithms(axis: Axis, value: float, problem: ExtremeProblem, budget: Budget) -> dict[str, Any]:
    """The point by plain Uzawa and by all other algorithms.

    Any wrong result makes the point wrong. Its numbers are those of the algorithm that is nearest to its
    bound, or beyond it. Where the axis sets rho there is no outcome of the library's own choice, which takes
    rho as it is given.
    """
    start = np.full(len(problem.lambda_H), axis.start(value, problem))
    verdicts = _judge_algorithms(problem, budget, start, value if axis.sets_rho else None)
    lambda_H = verdicts[ACTIVE_SET].lambda_H
    measured = np.nan if lambda_H is None else axis.measure(value, problem, lambda_H)
    nearest = max(verdicts.values(), key=lambda verdict: verdict.bound_share)
    if nearest.outcome == OUTCOME_WRONG:
        names = ", ".join(name for name, judged in verdicts.items() if judged.outcome == OUTCOME_WRONG)
        message = f"{names}: the error is above the bound, or there is none"
        return _tabulate_verdict(nearest, OUTCOME_WRONG, measured, message=message)
    plain = verdicts[PLAIN_UZAWA]
    tool = OUTCOME_NO_TOOL if axis.sets_rho else verdicts[LIBRARY_CHOICE].outcome
    return _tabulate_verdict(nearest, tool, measured, outcome=plain.outcome, message=plain.message)


def _judge_algorithms(
    problem: ExtremeProblem, budget: Budget, start: Array, share: float | None
) -> dict[str, RunVerdict]:
    """The verdicts on all algorithms by name, and on the library's choice, one of them with its own rho."""
    operator = problem.spaces.operator
    offset = problem.discrete.offset
    steps = budget.max_steps
    tolerance = budget.tolerance(problem)
    tool = _judge_or_refuse(
        problem, partial(run_algorithm, operator, offset, tolerance, Stop(max_steps=steps), start), tolerance
    )
    rho = None if share is None else share * 2 / operator.lambda_max
    verdicts: dict[str, RunVerdict] = {}
    for method in STEP_METHODS:
        if method == "newton" and operator.is_singular:
            continue
        method_rho = rho if method == PLAIN_UZAWA else None
        run = partial(uzawa, operator, offset, tolerance, method_rho, start, max_steps=steps, method=method)
        # The library's choice has run: its own result stands, unless the axis sets another rho
        is_library_choice = tool.algorithm == method and method_rho is None
        verdicts[method] = tool if is_library_choice else _judge_or_refuse(problem, run, tolerance)
    active_set = partial(solve_by_active_set, operator, offset, tolerance)
    verdicts[ACTIVE_SET] = (
        tool if tool.algorithm == ACTIVE_SET else _judge_or_refuse(problem, active_set, tolerance)
    )
    return verdicts | {LIBRARY_CHOICE: tool}


def _judge_or_refuse(problem: ExtremeProblem, run: Callable[[], DualResult], tolerance: float) -> RunVerdict:
    try:
        return judge_run(problem, run(), tolerance)
    except InputError as error:
        return RunVerdict(OUTCOME_REFUSED, str(error))


def judge_run(problem: ExtremeProblem, result: DualResult, tolerance: float) -> RunVerdict:
    """The verdict by the true error. A result that says more than is true, or nothing, is always wrong."""
    error = problem.error(result.lambda_H)
    allowance = problem.rounding_allowance
    bound = result.bound
    outcome = OUTCOME_RIGHT if result.converged else OUTCOME_NOT_CONVERGED
    # Right: error <= bound + allowance, finite, and the word `converged` says that bound <= tolerance
    if not error <= bound + allowance < np.inf or result.converged != (bound <= tolerance):
        outcome = OUTCOME_WRONG
    message = f"{result.iterations} steps"
    if not result.converged:
        message = f"bound {bound / tolerance:.2g} times the tolerance after {message}"
    return RunVerdict(
        outcome,
        message,
        result.algorithm,
        result.lambda_H,
        true_error=error,
        guaranteed=bound,
        allowance=allowance,
        tolerance=tolerance,
        u_norm=problem.norm(problem.u),
    )


# What axes share: measures, and limits where numbers cross what is allowed.


def measure_condition(value: float, problem: ExtremeProblem, mu: Array) -> float:
    """The condition number of S, as a measure."""
    return problem.condition


def find_crossing(values: Array, numbers: Array, limit: float) -> float:
    """The value, on logarithmic scales, where the numbers first pass the limit; NaN if they do not.

    Infinite, before all values, if the first number is beyond it.
    """
    x = np.log(values)
    y = np.log(numbers)
    above = np.flatnonzero(y > np.log(limit))
    if not above.size:
        return np.nan
    if above[0] == 0:
        return np.inf if values[-1] < values[0] else -np.inf
    k = above[0]
    if not np.isfinite(y[k]):
        return float(values[k])
    # Linear between both values in the logarithms
    return float(np.exp(x[k - 1] + (np.log(limit) - y[k - 1]) * (x[k] - x[k - 1]) / (y[k] - y[k - 1])))
