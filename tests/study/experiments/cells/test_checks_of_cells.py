"""The checks of cells of many sizes on made-up tables, by hand; see made_up.py."""

from functools import partial

import numpy as np
import pytest
from made_up import observes, table

from study.experiments.cells import checks as transitions

LARGEST_OF = {"table": "t", "variable": "discrete_error", "cases": ["cantor_2", "cantor_1.5"]}
LARGEST_OF |= {"required": 0.7, "is_minimum": False}


def make_cells(bound=0.001, converged=1.0, gap_order=(1.0, 3 / 4)):
    """Of two cases, H falls from 1 by 4 and by 16; D like H^1 and H^(1/2), then like H^(1/2) and H^(3/4).

    So exponents are 3/4 and 5/8, those of the consistency term 3/2 and 5/4. With these orders of gaps they
    are (sigma + tau)/2, which is less than sigma + 1/2, and sigma + tau. Two other cases have the same.
    """
    errors = np.array(2 * [[[1, 1 / 4], [1, 1 / 4]], [[1, 1 / 2], [1, 1 / 8]]])
    fields = {"discrete_error": errors, "consistency": errors**2, "algebraic_bound": bound * errors}
    fields |= {"converged": 0 * errors + converged}
    variables = {name: (("case", "start", "level"), value) for name, value in fields.items()}
    cases = ["cantor_2", "cantor_1.5", "violates_jjj", "violates_jj_jjj"]
    H = [[1, 1 / 4], [1, 1 / 16]]
    orders = {"flux_order": 4 * [1 / 2], "gap_order": 2 * list(gap_order)}
    return table(**variables, **orders, case=cases, H=(("start", "level"), H))


def alternating(last):
    """Over factors of 4 rates of 1/2 and, with 1/4 or 1/8 as the last error, of 1/2 or 1."""
    errors = np.array([[1.0, 9], [1 / 2, 8], [last, 7]])
    fields = {"discrete_error": errors, "algebraic_bound": 0 * errors, "converged": errors**0}
    variables = {name: (("partition", "gamma"), value) for name, value in fields.items()}
    return table(**variables, alpha=1 / 4, gamma=[0.5, 1], H=[1, 1 / 4, 1 / 16])


ROWS = [
    # The smallest exponent counts, or the largest; errors that were not found are not judged.
    ("T.jjj", make_cells(), (5 / 8, False)),
    ("S.jjj", make_cells(), (3 / 2, True)),
    ("S.jjj", make_cells(bound=0.02), "^the algebraic error is 0.02 of D$"),
    ("S.jjj", make_cells(converged=0.0), "of D$"),
    (partial(transitions.exponents, **LARGEST_OF), make_cells(), (3 / 4, False)),
    ("T.s", make_cells(), (0, True)),
    ("T.s", make_cells(gap_order=(1, 1)), (0.125, False)),
    ("T.c", make_cells(), (0, True)),
    ("T.c", make_cells(gap_order=(1, 1)), (0.25, False)),
    # Where each cell has contact and a gap, (1/4 + 1/2)/2 is expected.
    ("T.rough", alternating(1 / 8), (5 / 8, False)),
    ("T.rough", alternating(1 / 4), (1 / 8, False)),
    # The way to sigma + 1/2: 3/4 is at (1/2 + 1)/2, 5/8 at (1/2 + 3/4)/2; it begins at 3/8 for tau = 1/4, at
    # 1/4 for 0.
    ("T.g", make_cells(), (0, False)),
    ("T.g", make_cells(gap_order=(1 / 4, 1 / 4)), (0.4, False)),
    ("T.g", make_cells(gap_order=(0, 0)), (0.5, True)),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)
