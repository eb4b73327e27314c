"""The checks of graded meshes on made-up tables, by hand; see made_up.py."""

import numpy as np
import pytest
from made_up import NAN, observes, table


def on_graded(falls=(1.0, 2.0), kappa=(1.0, 1 / 2), bound=0.001, least=0.1, **changed):
    """Two runs with u like r^(4/3) (gamma is 4/3 and 8/3), three levels, and errors like 2^(-fall level).

    The mesh that is graded has the sizes 1, 1/e and 1/e^3, so that 1 + ln 1/h doubles from level to level.
    """
    errors = 2.0 ** -np.outer(falls, np.arange(3))
    names = "discrete_error hm12_error_lower hm12_error_upper singular_error weighted_ritz_means"
    of = dict.fromkeys(names.split(), errors) | changed
    of |= {"algebraic_bound": bound * errors, "equal_h": np.exp(np.array(2 * [[0, -1, -3]]))}
    of |= {"least_multiplier": least + 0 * errors}
    given = {name: (("run", "level"), each) for name, each in of.items()}
    labels = {"case": ("run", ["a", "b"]), "kappa": ("run", list(kappa)), "exponent": ("run", [4 / 3, 4 / 3])}
    return table(**given, **labels)


UNKNOWN = np.array([[1.0, 1 / 4, NAN], [1, 1 / 4, 1 / 16]])
ROWS = [
    # Required are 4/3 and 3/2, in each norm; of a pair that is not known nothing.
    ("A.G", on_graded(), (1 - 4 / 3, False)),
    ("A.G", on_graded(falls=(3 / 2, 3 / 2)), (0, True)),
    (
        "A.G",
        on_graded(falls=(3 / 2, 3 / 2), bound=0.02),
        "^the algebraic error is 0.02 of D$",
    ),
    ("A.G", on_graded(falls=(2, 2), hm12_error_upper=UNKNOWN), "^a run has 1 pairs$"),
    ("A.G", on_graded(falls=(2, 1), hm12_error_upper=UNKNOWN), (-1 / 2, False)),
    # Only gamma < 3/2 is asked not to be exceeded, on the finest pair, where all multipliers are positive.
    ("A.Gs", on_graded(), (1 - 4 / 3, True)),
    ("A.Gs", on_graded(least=0), "^lambda_H is 0 in a cell$"),
    ("A.Gs", on_graded(kappa=(1 / 2, 1 / 2)), "^there is nothing of which to find"),
    # The logarithm takes 1/2 from rates here, and is allowed for where gamma > 3/2.
    ("A.Gt", on_graded(falls=(4 / 3, 1)), (0, True)),
    ("A.Gt", on_graded(falls=(2, 3 / 4)), (-1 / 4, False)),
]


@pytest.mark.parametrize(("check", "given", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, given, expected):
    observes(check, given, expected)
