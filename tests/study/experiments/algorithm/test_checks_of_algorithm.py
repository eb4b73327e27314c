"""The checks of the algorithm on made-up tables, by hand; see made_up.py."""

import math

import numpy as np
import pytest
from made_up import INF, NAN, observes, table

SHARES = [0.25, 0.49, 0.51, 0.75, 0.99, 1.01, 1.1, 2.0]
LARGEST = math.sqrt(2) / math.tanh(1 / math.sqrt(8))
"""The bound 1/sigma_1 of lambda_max(S) on the unit square, where sqrt(2) sigma_1 = tanh(1/sqrt(8))."""


def distances(meant=(), printed=(), clipless=()):
    """Distances that are 1, but for those by their shares of the limit."""
    values = np.ones((2, 3, len(SHARES)))
    for k, changed in enumerate((meant, printed, clipless)):
        for share, distance in dict(changed).items():
            values[:, k, SHARES.index(share)] = distance
    return table(
        distance=(("case", "variant", "rho_share"), values),
        case=["full_contact", "natural"],
        variant=["as meant", "as printed", "without the clip"],
        rho_share=SHARES,
    )


CONVERGED = dict.fromkeys(SHARES, 1e-5)


def lambda_max(below):
    """(1 - below)/sigma_1 on the finer mesh."""
    return table(lambda_max=[[0.9 * LARGEST * (1 - below)], [LARGEST * (1 - below)]])


def uzawa(level):
    """Steps log(1/tolerance)/H, but three times that on one level."""
    H = 0.5 ** np.arange(2, 7)
    tolerance = np.diag(0.1 ** np.arange(3, 8))
    steps = np.diag(np.log(1 / np.diag(tolerance)) / H)
    steps[level, level] *= 3
    case = ["full_contact"]
    return table(iterations=[steps], tolerance=[tolerance], h_over_H=H[:, None] / (2 * H), case=case, H=H)


ROWS = [
    ("5.2a", distances(CONVERGED), (1e-5, True)),
    # A cycle is between 0.1 and 10: the smallest distance counts, but the largest if it is above.
    ("5.2b", distances({1.01: 0.5, 2.0: 3.0}), (0.5, True)),
    ("5.2b", distances({1.01: 0.5, 2.0: 11.0}), (11.0, False)),
    ("5.2b", distances({1.01: 0.5, 2.0: INF}), (INF, False)),
    # The printed index has to converge below half the limit, up to a factor of 2; above it is 4000/2.
    ("5.1", distances({0.51: 2.0}, {0.49: 2.0, 0.51: 4000.0}), (2000.0, True)),
    ("5.3", distances({0.49: 0.001}, clipless={0.49: 2.0}), (2000.0, True)),
    # An eigenvalue above the Steklov bound is no small distance.
    ("5.2c", lambda_max(5e-4), (5e-4, True)),
    ("5.2c", lambda_max(-1e-14), (-1e-14, True)),
    ("5.2c", lambda_max(-1e-4), (-1e-4, False)),
    # A cheaper step has to be the same step.
    ("5.A", table(with_A=[6, 10], with_A_3=[2, 4], difference=1e-11, h=[1, 1 / 2]), (2.5, True)),
    ("5.A", table(with_A=[6, 10], with_A_3=[2, 4], difference=1e-9, h=[1, 1 / 2]), (1e-9, False)),
    # Steps are compared with their law from H = 1/16 on: the first two levels do not count.
    *[("5.B", uzawa(level), pytest.approx(1.0, rel=1e-12)) for level in (0, 1)],
    *[("5.B", uzawa(level), pytest.approx(3.0, rel=1e-12)) for level in (2, 4)],
    # A saddle grows in both variables.
    ("R1.1", table(saddle_in_v=[1.0, 1.0], saddle_in_mu=[1.0, 1.0], case=["c", "d"]), 1),
    ("R1.1", table(saddle_in_v=[1.0, -0.5], saddle_in_mu=[1.0, 1.0], case=["c", "d"]), (-0.5, False)),
    ("R1.1", table(saddle_in_v=[1.0, 1.0], saddle_in_mu=[1.0, -0.5], case=["c", "d"]), (-0.5, False)),
    # Two multipliers are two only if they are apart.
    ("3.th", table(violation=1e-15, same_u=1e-14, multiplier_distance=0.5), (1e-14, True)),
    ("3.th", table(violation=1e-3, same_u=1e-14, multiplier_distance=0.5), (1e-3, False)),
    ("3.th", table(violation=1e-15, same_u=1e-14, multiplier_distance=0.05), (0.05, False)),
    # Near is from either side.
    ("1.8", table(multiplier_factor=[2.125, 1.5]), 0.25),
    ("4.3", table(diagonal=[1.125, NAN]), "how far .* is not known of diagonal"),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
