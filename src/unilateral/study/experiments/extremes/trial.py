"""A problem tried by every algorithm that the library offers, and by the one that it takes itself."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial

import numpy as np

from unilateral.errors import InputError
from unilateral.solvers.active_set import active_set
from unilateral.solvers.iterate import iterate
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import DualResult, uzawa
from unilateral.solvers.uzawa_steps import STEPS
from unilateral.study.experiments.extremes.outcome import NO_TOOL, REFUSED, WRONG, Budget, Row, Verdict, judge
from unilateral.study.experiments.extremes.problem import Array, ExtremeProblem

PLAIN, EXACT, TOOL = "uzawa", "active_set", "the tool"
Measure = Callable[[ExtremeProblem, Array], float]
"""A function that gives a number from a problem and the active set's lambda_H (m,)."""
Start = float | Callable[[float, ExtremeProblem], float | Array]
"""lambda^0, on every cell or (m,); it may depend on the value on the axis and on the problem."""


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
