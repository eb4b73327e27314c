"""The checks of the cost on made-up tables, by hand; see made_up.py."""

from functools import partial

import numpy as np
import pytest
from made_up import NAN, observes, table

from study.experiments.cost import checks as cost

SIZES = [1 / 8, 1 / 16, 1 / 32]


def steps_of(stops=(0.1, 0.01), **steps):
    """Steps (H/h, H) of algorithms to the last of two levels; to the first one all take one."""
    values = np.array([np.broadcast_to(step, (2, 3)) for step in steps.values()], dtype=float)
    by_axis = (("algorithm", "H_over_h", "H", "stop"), np.stack([values**0, values], axis=-1))
    return table(steps=by_axis, algorithm=list(steps), H_over_h=[2.0, 4.0], H=("H", SIZES), stop=list(stops))


FEWER = steps_of(fast=[[1, 2, 4], [1, NAN, 8]], slow=[[3, 1, 1], [2, 2, 4]])
SAFE = [12, 23, 34]
SLOWER = [12, 26, 34]


def errors_at_a_level(error, lower=1.0, ran=True):
    """Errors (H,) at the level 0.1, of a discrete solution with the error 1."""
    dims = ("case", "H_over_h", "H")
    ones = np.ones((1, 1, 3))
    h1 = np.broadcast_to(np.asarray(error, float), (3,)).reshape(1, 1, 3, 1)
    hm12 = np.broadcast_to(np.asarray(lower, float), (3,)).reshape(1, 1, 3, 1)
    return table(
        **dict.fromkeys(("h1_discrete", "hm12_discrete_lower"), (dims, ones)),
        setup_operations=(dims, np.where(ran, ones, NAN)),
        h1_error=((*dims, "stop"), h1),
        hm12_error_lower=((*dims, "stop"), hm12),
        **{"case": ["natural"], "H_over_h": [2.0], "H": ("H", SIZES), "stop": [0.1]},
    )


def make_operations(with_A):
    """n = e^2, e^4 with quotients of operations 2 and 6, so 6/4 over 2/2; S takes 5 and 7 steps."""
    dims = ("algebra", "H")
    n = np.exp([[2.0, 4.0], [2.0, 4.0]])
    operations = [[4.0, 18.0], [2.0, 3.0]]
    steps = [with_A, [[5], [7]]]
    h = [[0.5, 0.25], [0.5, 0.25]]
    variables = {"step_operations": (dims, operations), "unknowns": (dims, n), "h": (dims, h)}
    return table(**variables, steps=((*dims, "stop"), steps), algebra=["A", "S"])


UNLIKE = "steps with A are not known to be as many as those with S"
STEEPER = partial(cost.step_economy, at_least=1.6)


ROWS = [
    # Growth by factors of 6/3 and 4/2 at H/h = 2; one run less at 4, so 8/(2 * 2). From 1/16 on 4/2 only.
    (
        partial(cost.relative_step_growth, algorithm="fast", reference="slow", coarsest=1.0, at_most=1.0),
        FEWER,
        6,
    ),
    (
        partial(cost.relative_step_growth, algorithm="fast", reference="slow", coarsest=1 / 16, at_most=1.0),
        FEWER,
        2,
    ),
    ("5.F", steps_of(newton=[[1, 2, 3], [7, 5, NAN]]), 7),
    # Steps but one, where the optimal step took any; or the number of levels that only that one met.
    ("5.G", steps_of(safe=SAFE, optimal=[10, 20, 30]), (1.1, True)),
    ("5.G", steps_of(safe=[12, NAN, 34], optimal=[10, 20, 30]), (1.0, False)),
    ("5.G", steps_of(safe=[12, NAN, 34], optimal=[10, NAN, 30]), (1.1, True)),
    ("5.G", steps_of(safe=[12, 99, 34], optimal=[10, 0, 30]), (1.1, True)),
    # Where rounding may decide nothing counts; at the first level all take one step: none but one.
    ("5.G", steps_of((1e-8, 1e-9), safe=SLOWER, optimal=[10, 20, 30]), (0.0, True)),
    # The largest excess from H = 1/16 on; what was not run does not count.
    ("5.H", errors_at_a_level([9.0, 1.25, 1.0]), 0.25),
    ("5.H", errors_at_a_level([9.0, NAN, 1.5]), 0.5),
    ("5.H", errors_at_a_level([9.0, NAN, 1.0], ran=[True, False, True]), 0.0),
    ("5.H", errors_at_a_level([9.0, NAN, 1.0]), r"a run of natural does not reach the level 0\.1"),
    # The least growth from H = 1/16 on, 4/3; it is 3/5 before.
    ("5.I", errors_at_a_level(1.0, [5.0, 3.0, 4.0]), (4 / 3, True)),
    ("5.I", errors_at_a_level(1.0, [5.0, 3.0, NAN]), "growth .* is not known of natural, H = 0.03125"),
    # A step by cells has to be the same step, if its growth would pass.
    *[("5.J", make_operations(steps), 1.5) for steps in ([[5], [7]], [[5], [NAN]])],
    *[("5.J", make_operations(steps), UNLIKE) for steps in ([[5], [8]], [[NAN], [NAN]])],
    *[(STEEPER, make_operations(steps), 1.5) for steps in ([[5], [7]], [[5], [8]])],
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
