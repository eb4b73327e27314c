"""A problem tried by every algorithm that the library offers, and by the one that it takes itself."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from unilateral.errors import InputError
from unilateral.solvers.active_set import active_set
from unilateral.solvers.iterate import Stop, iterate
from unilateral.solvers.steps import STEPS
from unilateral.solvers.uzawa import DualResult, uzawa
from unilateral.study.runs.extremes.outcome import NO_TOOL, REFUSED, WRONG, Budget, Row, Verdict, judge
from unilateral.study.runs.extremes.problem import Array, Problem

PLAIN, EXACT, TOOL = "uzawa", "active_set", "the tool"
Measure = Callable[[Problem, Array], float]
"""A number of a problem and the active set's lambda_H (m,)."""


@dataclass(frozen=True, eq=False)
class Trial:
    """The verdict on one run, what is said of it, and its lambda_H (m,), NaN where it is refused."""

    verdict: Verdict
    said: str
    lambda_H: Array


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
        trials = _trials(problem, budget, start, share)
        exact = trials[EXACT]
        number = np.nan if exact.verdict.outcome == REFUSED else measure(problem, exact.lambda_H)
    return _row(value, trials, number, share is None)


def attempts(
    values: Array,
    make: Callable[[float], Problem],
    budget: Budget,
    measure: Measure,
    start: float = 0.0,
) -> list[Row]:
    """An attempt for every value, from mild to extreme."""
    return [attempt(value, make, budget, measure, start) for value in values.tolist()]


def _trials(problem: Problem, budget: Budget, start: float | Array, share: float | None) -> dict[str, Trial]:
    """Of every algorithm by its name, and of the tool's choice."""
    operator, offset, steps = problem.spaces.operator, problem.discrete.offset, budget.max_steps
    of, begin = (operator, offset, budget.tolerance(problem)), np.full(len(offset), start)
    rho = {PLAIN: None if share is None else share * 2 / operator.lambda_max}
    runs: dict[str, Callable[[], DualResult]] = {
        method: partial(uzawa, *of, rho.get(method), begin, steps, method)
        for method in STEPS
        if not (method == "newton" and operator.singular)
    }
    runs[EXACT] = partial(active_set, *of)
    runs[TOOL] = partial(iterate, *of, Stop(max_steps=steps), begin)
    return {name: _trial(problem, run, of[-1]) for name, run in runs.items()}


def _trial(problem: Problem, run: Callable[[], DualResult], tolerance: float) -> Trial:
    try:
        result = run()
    except InputError as error:
        return Trial(Verdict(REFUSED), str(error), np.full(len(problem.discrete.offset), np.nan))
    return Trial(judge(problem, result, tolerance), _said(result, tolerance), result.lambda_H)


def _row(value: float, trials: dict[str, Trial], number: float, tooled: bool) -> Row:
    """The numbers are those of the algorithm that is nearest to its bound."""
    worst = max((each.verdict for each in trials.values()), key=lambda verdict: verdict.used)
    if worst.outcome == WRONG:
        names = ", ".join(name for name, each in trials.items() if each.verdict.outcome == WRONG)
        said = f"{names}: the error is above the bound, or there is none"
        return Row(value, WRONG, WRONG, *worst.numbers, number, message=said)
    outcome, tool = trials[PLAIN].verdict.outcome, trials[TOOL].verdict.outcome if tooled else NO_TOOL
    return Row(value, outcome, tool, *worst.numbers, number, message=trials[PLAIN].said)


def _said(result: DualResult, tolerance: float) -> str:
    if result.converged:
        return f"{result.iterations} steps"
    return f"bound {result.bound / tolerance:.2g} times the tolerance after {result.iterations} steps"
