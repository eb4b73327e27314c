"""The checks of graded meshes on made-up tables, by hand; see made_up.py."""

import numpy as np
import pytest
from made_up import NAN, observes, table


def make_graded_runs(falls=(1.0, 2.0), kappa=(1.0, 1 / 2), bound=0.001, minimum=0.1, **changed):
    """Two runs with u like r^(4/3) (gamma is 4/3 and 8/3), three levels, and errors like 2^(-fall level).

    The mesh that is graded has the sizes 1, 1/e and 1/e^3, so that 1 + ln 1/h doubles from level to level.
    """
    errors = 2.0 ** -np.outer(falls, np.arange(3))
    names = "discrete_error hm12_error_lower hm12_error_upper singular_error weighted_ritz_means"
    fields = dict.fromkeys(names.split(), errors) | changed
    fields |= {"algebraic_bound": bound * errors, "equal_h": np.exp(np.array(2 * [[0, -1, -3]]))}
    fields |= {"least_multiplier": minimum + 0 * errors}
    variables = {name: (("run", "level"), value) for name, value in fields.items()}
    labels = {"case": ("run", ["a", "b"]), "kappa": ("run", list(kappa)), "exponent": ("run", [4 / 3, 4 / 3])}
    return table(**variables, **labels)


UNKNOWN = np.array([[1.0, 1 / 4, NAN], [1, 1 / 4, 1 / 16]])
ROWS = [
    # Required are 4/3 and 3/2, in each norm; of a pair that is not known nothing.
    ("A.G", make_graded_runs(), (1 - 4 / 3, False)),
    ("A.G", make_graded_runs(falls=(3 / 2, 3 / 2)), (0, True)),
    (
        "A.G",
        make_graded_runs(falls=(3 / 2, 3 / 2), bound=0.02),
        "^the algebraic error is 0.02 of D$",
    ),
    ("A.G", make_graded_runs(falls=(2, 2), hm12_error_upper=UNKNOWN), "^a run has 1 pairs$"),
    ("A.G", make_graded_runs(falls=(2, 1), hm12_error_upper=UNKNOWN), (-1 / 2, False)),
    # Only gamma < 3/2 is asked not to be exceeded, on the finest pair, where all multipliers are positive.
    ("A.Gs", make_graded_runs(), (1 - 4 / 3, True)),
    ("A.Gs", make_graded_runs(minimum=0), "^lambda_H is 0 in a cell$"),
    ("A.Gs", make_graded_runs(kappa=(1 / 2, 1 / 2)), "^there is nothing of which to find"),
    # The logarithm takes 1/2 from rates here, and is allowed for where gamma > 3/2.
    ("A.Gt", make_graded_runs(falls=(4 / 3, 1)), (0, True)),
    ("A.Gt", make_graded_runs(falls=(2, 3 / 4)), (-1 / 4, False)),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
