"""The checks of the extremes on made-up tables, by hand; see made_up.py."""

from functools import partial

import pytest
from made_up import INF, NAN, observes, table

from study.experiments.extremes import checks as extremes
from study.experiments.extremes.outcome import (
    NEVER_RIGHT,
    OUTCOME_NOT_CONVERGED,
    OUTCOME_REFUSED,
    OUTCOME_RIGHT,
    OUTCOME_WRONG,
)


def points(**values):
    """On an axis a, the sixth one on another."""
    n = len(values["value"])
    return table(axis_of=5 * ["a"] + ["b"] if n == 6 else n * ["a"], **values)


SLOPE = points(value=[1, 1 / 4, 1 / 8, 1 / 16, 1 / 32, 1 / 64], measured=[9, 48, 192, NAN, 3072, 1])
"""3 x^-2 on x = 1/4, 1/8, 1/32; what is coarser, not known or elsewhere is not in the slope, -2."""


def power(exponent):
    return partial(extremes.power_law, table="t", axis="a", max_value=0.25, exponent=exponent, at_most=0.1)


def axes(**changed):
    """A table of two axes, the first upwards with a limit, the second downwards without."""
    fields = {
        "axis_of": ["up", "up", "down", "down"],
        "value": [1.0, 2.0, 1.0, 0.5],
        "outcome": [OUTCOME_RIGHT, OUTCOME_NOT_CONVERGED, OUTCOME_RIGHT, OUTCOME_REFUSED],
        "tool": [OUTCOME_RIGHT, OUTCOME_RIGHT, OUTCOME_RIGHT, OUTCOME_REFUSED],
        "true_error": [0.5, 0.5, 1.05, NAN],
        "guaranteed": [1.0, 1.0, 1.0, NAN],
        "allowance": [0.1, 0.1, 0.1, NAN],
        "predicted_limit": [1.999, NAN],
        "measured_limit": [2.0, NAN],
        "predicted_tool_limit": [NAN, NAN],
        "measured_tool_limit": [NAN, NAN],
    }
    return table(**fields | changed, axis=["up", "down"])


def make_other_solver(error, bound):
    """Of the last point, that one solver refuses, numbers by another one."""
    variables = {"true_error": [0.5, 0.5, 1.05, error], "guaranteed": [1.0, 1.0, 1.0, bound]}
    return axes(**variables, allowance=4 * [0.1])


def step_limit(distance):
    return partial(extremes.step_limit, table="t", nearest={"up": distance})


def steps(limit, *outcome):
    return axes(predicted_limit=[limit, NAN], outcome=[*outcome, OUTCOME_RIGHT, OUTCOME_REFUSED])


def floors(*measured):
    return points(value=[1.0, 0.5], predicted=[1.0, 4.0], measured=list(measured))


STEPS = table(measured_limit=[1.5, 1.0], axis=["step_partial", "b"])
FLOOR = partial(extremes.rounding_floor, table="t", axis="a", factor=5.0)


def make_sizes(work):
    """Work of one case at h = 1/16, 1/32 and 1/33."""
    return table(case=["a"], h=("mesh", [1 / 16, 1 / 32, 1 / 33]), work=(("case", "mesh"), work))


def make_reaction_rows(**changed):
    """Errors and bounds of one case on one mesh, for c/k = 0, 1e-6 and 1."""
    fields = {
        "energy_error": [2.0, 2.01, 8.0],
        "cheap_bound": [3.0, 3.0, 40.0],
        "sharp_bound": [2.2, 2.2, 8.0],
    }
    values = {name: (("case", "mesh", "c_over_k"), [[value]]) for name, value in (fields | changed).items()}
    return table(case=["a"], h=[0.125], c_over_k=[0.0, 1e-6, 1.0], **values)


ROWS = [
    # The cheap bound over the error is told, unless the sharp bound or one below the error is at fault.
    ("X.robust", make_reaction_rows(), (5.0, True)),
    ("X.robust", make_reaction_rows(cheap_bound=[3.0, 3.0, 81.0]), (81 / 8, False)),
    ("X.robust", make_reaction_rows(sharp_bound=[2.2, 2.2, 41.0]), (41 / 8, False)),
    ("X.robust", make_reaction_rows(sharp_bound=[2.2, 2.2, 7.9]), (7.9 / 8, False)),
    ("X.robust", make_reaction_rows(cheap_bound=[1.9, 3.0, 40.0]), (0.95, False)),
    ("X.robust", make_reaction_rows(energy_error=[2.0, NAN, 8.0]), (INF, False)),
    ("X.robust", make_reaction_rows(sharp_bound=[2.2, NAN, 8.0]), (INF, False)),
    # c/k = 1 is not compared with 0, and what is not known differs.
    ("X.tiny", make_reaction_rows(), (0.005, True)),
    ("X.tiny", make_reaction_rows(energy_error=[2.0, 2.03, 8.0]), (0.015, False)),
    ("X.tiny", make_reaction_rows(sharp_bound=[2.2, 2.3, 8.0]), (2.3 / 2.2 * 2 / 2.01 - 1, False)),
    ("X.tiny", make_reaction_rows(cheap_bound=[3.0, NAN, 40.0]), (INF, False)),
    # Sizes that differ by 5 % or more are not compared; work that falls is a cliff on the way back.
    ("X.cost", make_sizes(work=[[9.0, 1.0, 1.25]]), (1.25, True)),
    ("X.cost", make_sizes(work=[[1.0, 2.0, 1.0]]), (2.0, False)),
    ("X.cost", make_sizes(work=[[1.0, 1.0, 1.6]]), (1.6, False)),
    *[(power(exponent), SLOPE, distance) for exponent, distance in ((-2, 0), (-1, 1), (-3, 1))],
    (power(-2), points(value=[0.2, 0.1], measured=[1, NAN]), "fewer than two numbers are known on the"),
    # The first step that fails is the measured one.
    ("X.partial", STEPS, (1.5, True)),
    # Outcomes are recomputed.
    ("X.wrong", axes(), 0),
    ("X.wrong", axes(true_error=[0.5, 1.2, 1.05, NAN]), 1),
    ("X.wrong", axes(true_error=[0.5, NAN, 1.05, NAN]), 1),
    ("X.wrong", axes(outcome=[OUTCOME_WRONG, OUTCOME_RIGHT, OUTCOME_RIGHT, OUTCOME_REFUSED]), 1),
    ("X.wrong", axes(guaranteed=[1.0, INF, 1.0, NAN]), 1),
    ("X.wrong", axes(allowance=[0.1, INF, 0.1, NAN]), 1),
    ("X.wrong", make_other_solver(0.5, 1.0), 0),
    ("X.wrong", make_other_solver(2.0, 1.0), 1),
    ("X.wrong", make_other_solver(NAN, 1.0), 1),
    ("X.wrong", make_other_solver(0.5, INF), 1),
    # A limit that is met early counts, and one where all was promised; where nothing was none is early.
    ("X.limits", axes(), 0),
    ("X.limits", axes(predicted_limit=[2.001, NAN]), 1),
    ("X.limits", axes(measured_limit=[2.0, 0.5]), 1),
    ("X.limits", axes(measured_tool_limit=[2.0, NAN]), 1),
    ("X.limits", axes(measured_tool_limit=[NAN, 1.0]), 1),
    ("X.limits", axes(predicted_limit=[1.999, NEVER_RIGHT], measured_limit=[2.0, 1.0]), 0),
    # Steps on the wrong side of their limit count if it was tried next to it.
    (step_limit(1 / 3), steps(1.5, OUTCOME_RIGHT, OUTCOME_NOT_CONVERGED), 0),
    (step_limit(1 / 3), steps(1.5, OUTCOME_RIGHT, OUTCOME_RIGHT), 1),
    (step_limit(1 / 3), steps(1.5, OUTCOME_REFUSED, OUTCOME_NOT_CONVERGED), 1),
    (step_limit(0.2), steps(2.5, OUTCOME_RIGHT, OUTCOME_NOT_CONVERGED), 1),
    (
        step_limit(0.1),
        steps(1.5, OUTCOME_RIGHT, OUTCOME_NOT_CONVERGED),
        r"^0\.9 of the limit was not tried on",
    ),
    # Floors are within a factor, and outgrow their predictions.
    (FLOOR, floors(2.0, 16.0), 0),
    *[(FLOOR, floors(*pair), 1) for pair in ((2.0, 26.0), (0.19, 5.0), (2.0, 8.0))],
    *[(FLOOR, floors(*pair), 1) for pair in ((3.0, 3.0), (2.0, NAN))],
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
