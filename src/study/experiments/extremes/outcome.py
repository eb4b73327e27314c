"""What becomes of a problem: right, not converged with a valid bound, refused, or wrong.

It is tried by every algorithm that the library offers, and by the one that the library takes itself.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np

from study.experiments.extremes.problem import ExtremeProblem
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.solvers.active_set import active_set
from unilateral.solvers.dispatch import iterate
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult, uzawa
from unilateral.solvers.uzawa_steps import STEPS

RIGHT, NOT_CONVERGED, REFUSED, WRONG = ("right", "not converged", "refused", "wrong")
NO_TOOL = ""
"""The outcome of the library's own choice where the library offers no such thing."""
NOTHING = np.inf
"""The limit on an axis with falling values where nothing is predicted to be right by plain Uzawa."""
PLAIN, EXACT, TOOL = "uzawa", "active_set", "the tool"
Measure = Callable[[ExtremeProblem, Array], float]
"""A function that gives a number from a problem and the active set's lambda_H (m,)."""
Start = float | Callable[[float, ExtremeProblem], float | Array]
"""lambda^0, on every cell or (m,); it may depend on the value on the axis and on the problem."""


@dataclass(frozen=True, kw_only=True)
class Numbers:
    """The error ||u(mu) - u_h||_1, the bound that is told, the allowance for rounding, and the tolerance.

    `u_norm` is ||u_h||_1. All are NaN for what is refused.
    """

    true_error: float = np.nan
    guaranteed: float = np.nan
    allowance: float = np.nan
    tolerance: float = np.nan
    u_norm: float = np.nan

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers by name."""
        return {field.name: getattr(self, field.name) for field in fields(Numbers)}


@dataclass(frozen=True, eq=False)
class Verdict(Numbers):
    """The outcome of a run with its numbers; what is said of it; its lambda_H (m,), if it was not refused.

    `algorithm` is the one that ran, empty if it refused.
    """

    outcome: str
    said: str
    algorithm: str = ""
    lambda_H: Array | None = None

    @property
    def used(self) -> float:
        """The share of the bound that the error takes; all of it if wrong, less than any other if refused."""
        if self.outcome in (WRONG, REFUSED):
            return np.inf if self.outcome == WRONG else -1.0
        allowed = self.guaranteed + self.allowance
        return self.true_error / allowed if allowed > 0 else 0.0


@dataclass(frozen=True)
class Row(Numbers):
    """A point of an axis: the outcomes of plain Uzawa and of the library's choice, a number, its prediction.

    The numbers are those of the algorithm that is nearest to its bound, or beyond it.
    """

    value: float
    outcome: str
    tool: str
    measured: float = np.nan
    predicted: float = np.nan
    message: str = ""


@dataclass(frozen=True)
class Axis:
    """The rows, and the values up to which plain Uzawa and the library's choice are predicted to be right.

    NaN stands for everywhere. `local_limit` is the value up to which plain Uzawa converges from nearby; it is
    NaN where that is not asked for.
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

    def tolerance(self, problem: ExtremeProblem) -> float:
        """The tolerance in ||.||_{-1/2,h}; relative to 1 where lambda_H is 0."""
        return self.accuracy * (problem.size or 1.0)

    @property
    def condition(self) -> float:
        """The largest cond(S) for which plain Uzawa needs no more steps, with rho = 1.9/lambda_max(S)."""
        return 1.9 * self.max_steps / -np.log(self.accuracy)

    @property
    def accelerated(self) -> float:
        """The largest cond(S) for which Nesterov needs no more steps, contracting by 1 - cond(S)^{-1/2}."""
        return float((self.max_steps / np.log(self.accuracy)) ** 2)


def judge(problem: ExtremeProblem, result: DualResult, tolerance: float) -> Verdict:
    """The verdict by the true error. A result that says more than is true, or nothing, is always wrong."""
    error, allowance, bound = problem.error(result.lambda_H), problem.allowance, result.bound
    outcome = RIGHT if result.converged else NOT_CONVERGED
    if not error <= bound + allowance < np.inf or result.converged != (bound <= tolerance):
        outcome = WRONG
    said = f"{result.iterations} steps"
    if not result.converged:
        said = f"bound {bound / tolerance:.2g} times the tolerance after {said}"
    numbers = {"true_error": error, "guaranteed": bound, "allowance": allowance, "tolerance": tolerance}
    numbers["u_norm"] = problem.norm(problem.u)
    return Verdict(outcome, said, result.algorithm, result.lambda_H, **numbers)


def attempt(
    value: float,
    make: Callable[[float], ExtremeProblem],
    budget: Budget,
    measure: Measure,
    start: Start = 0.0,
    share: float | None = None,
) -> Row:
    """The row of plain Uzawa from `start`, with rho a share of 2/lambda_max(S), and of all other algorithms.

    Any wrong result makes the point wrong; only an InputError counts as refused. With a share there is no
    outcome of the library's own choice, which takes rho as it is given.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        try:
            problem = make(value)
        except InputError as error:
            return Row(value, REFUSED, REFUSED, message=str(error))
        begin = np.full(len(problem.lambda_H), start(value, problem) if callable(start) else start)
        verdicts = _verdicts(problem, budget, begin, share)
        lambda_H = verdicts[EXACT].lambda_H
        number = np.nan if lambda_H is None else measure(problem, lambda_H)
    plain, worst = verdicts[PLAIN], max(verdicts.values(), key=lambda verdict: verdict.used)
    if worst.outcome == WRONG:
        names = ", ".join(name for name, each in verdicts.items() if each.outcome == WRONG)
        said = f"{names}: the error is above the bound, or there is none"
        return Row(value, WRONG, WRONG, number, message=said, **worst.numbers)
    tool = NO_TOOL if share is not None else verdicts[TOOL].outcome
    return Row(value, plain.outcome, tool, number, message=plain.said, **worst.numbers)


def attempts(
    values: Array,
    make: Callable[[float], ExtremeProblem],
    budget: Budget,
    measure: Measure,
    start: Start = 0.0,
) -> list[Row]:
    """An attempt for every value, from mild to extreme."""
    return [attempt(value, make, budget, measure, start) for value in values.tolist()]


def condition(problem: ExtremeProblem, _: Array) -> float:
    """The condition number of S, as a measure."""
    return problem.condition


def _verdicts(
    problem: ExtremeProblem, budget: Budget, begin: Array, share: float | None
) -> dict[str, Verdict]:
    """The verdicts on all algorithms by name, and on the library's choice, one of them with its own rho."""
    operator, offset, steps = problem.spaces.operator, problem.discrete.offset, budget.max_steps
    of = (operator, offset, budget.tolerance(problem))
    tool = _verdict(problem, partial(iterate, *of, Stop(max_steps=steps), begin), of[-1])
    rho = {PLAIN: None if share is None else share * 2 / operator.lambda_max}
    runs: dict[str, Callable[[], DualResult]] = {
        method: partial(uzawa, *of, rho.get(method), begin, steps, method)
        for method in STEPS
        if not (method == "newton" and operator.singular)
    }
    runs[EXACT] = partial(active_set, *of)
    known = {tool.algorithm: tool} if rho.get(tool.algorithm) is None else {}
    verdicts = {name: known.get(name) or _verdict(problem, run, of[-1]) for name, run in runs.items()}
    return verdicts | {TOOL: tool}


def _verdict(problem: ExtremeProblem, run: Callable[[], DualResult], tolerance: float) -> Verdict:
    try:
        return judge(problem, run(), tolerance)
    except InputError as error:
        return Verdict(REFUSED, str(error))


def predicted(rows: Sequence[Row], values: Array) -> list[Row]:
    """The rows with what is predicted of their numbers."""
    return [replace(row, predicted=float(value)) for row, value in zip(rows, values, strict=True)]


def within(rows: Sequence[Row], slack: float) -> list[Row]:
    """The rows, wrong where the number is above `slack` and above what is predicted."""

    def judged(row: Row) -> Row:
        refused = row.outcome == REFUSED and np.isnan(row.measured)
        if refused or row.measured <= max(row.predicted, slack):
            return row
        said = f"{row.measured:.2g}, predicted {row.predicted:.2g}"
        return replace(row, outcome=WRONG, tool=WRONG, message=said)

    return [judged(row) for row in rows]


def by_law(rows: Sequence[Row], values: Array, growth: Array, budget: Budget) -> Axis:
    """The axis on which cond(S) is predicted to grow like `growth` from that of the first row.

    Its limits follow from the steps that the budget allows.
    """
    numbers = rows[0].measured * growth
    limits = (crossing(values, numbers, most) for most in (budget.condition, budget.accelerated))
    return Axis(predicted(rows, numbers), *limits)


def crossing(values: Array, numbers: Array, limit: float) -> float:
    """The value, on logarithmic scales, where the numbers first pass the limit; NaN if they do not.

    Infinite, before all values, if the first number is beyond it.
    """
    x, y = np.log(values), np.log(numbers)
    above = np.flatnonzero(y > np.log(limit))
    if not above.size:
        return np.nan
    if above[0] == 0:
        return np.inf if values[-1] < values[0] else -np.inf
    k = above[0]
    if not np.isfinite(y[k]):
        return float(values[k])
    return float(np.exp(x[k - 1] + (np.log(limit) - y[k - 1]) * (x[k] - x[k - 1]) / (y[k] - y[k - 1])))
