"""The checks that serve several experiments, on made-up tables: every branch of theirs is taken, by hand.

Those of one experiment are tested beside it.
"""

from functools import partial

import numpy as np
import pytest
import sentences
import xarray as xr
from made_up import INF, NAN, observes, table

from study import evidence
from study.evidence import Unjudged
from study.ledger import checks as shared
from unilateral.errors import InputError


def number(observed):
    """That has to be 1 at least."""
    return evidence.pick_worst({"a": observed}, "", 1.0, True)


def test_the_worst_of_nothing_or_of_what_is_not_known_is_not_judged():
    for values, message in (
        ({}, "there is nothing of which to find the gap"),
        ({"a": 1.0, "b": NAN, "c": NAN, "d": INF}, "the gap is not known of b; c"),
    ):
        with pytest.raises(Unjudged, match=message):
            evidence.pick_worst(values, "the gap", 0.0, True)
    assert evidence.pick_worst({"a": 1.0, "b": INF}, "", 0.0, False).observed == INF
    assert evidence.pick_worst({"a": 1.0, "b": 2.0}, "", 0.0, True).observed == 1
    assert evidence.pick_worst({"a": 1.0, "b": 2.0}, "", 0.0, False).observed == 2


def test_of_a_statement_in_parts_the_first_that_fails_is_told():
    numbers = [number(observed) for observed in (3.0, 2.0, 0.5, 0.25)]
    assert evidence.require_all(*numbers) is numbers[2]
    assert evidence.require_all(*numbers[:2]) is numbers[0]


def test_faults_are_a_verdict_of_their_own_only_where_the_number_would_pass():
    assert evidence.require_preconditions(number(0.5), ["fault"]) == number(0.5)
    assert evidence.require_preconditions(number(1.0), []) == number(1.0)
    with pytest.raises(Unjudged, match=r"^one fault; another$"):
        evidence.require_preconditions(number(1.0), ["one fault", "another"])


# Expressions

MADE = table(
    x=(("case", "H"), [[3.0, NAN, 7.0], [4.0, 5.0, 6.0]]),
    y=("case", [NAN, NAN]),
    case=["d", "c"],
    H=("H", [1, 1 / 2, 1 / 4]),
)


@pytest.mark.parametrize(
    ("parameters", "lines"),
    [
        ({"value": "x", "at_least": 1}, ["t: 3"]),
        ({"value": "x", "at_most": 1}, ["t: 7"]),
        ({"value": "x", "at_most": 1, "scenes": ["a", "b"]}, ["a: 7", "b: 7"]),
        ({"value": "x", "at_most": 1, "rows": "{scene}, {case}"}, ["t, d: 7", "t, c: 6"]),
        ({"value": "x", "at_most": 1, "cases": ["d", "e", "c"], "rows": "{case}"}, ["c: 6", "d: 7"]),
        ({"value": "x", "at_most": 1, "select": {"case": "c"}, "rows": "{case}"}, ["c: 6"]),
        ({"value": "x", "at_least": 1, "rows": "H = {H:g}"}, ["H = 1: 3", "H = 0.5: 5", "H = 0.25: 6"]),
        ({"value": "x", "at_least": 1, "where": "H < 1 and not x > 6", "rows": "{case}"}, "not known of d$"),
        ({"value": "x", "at_least": 1, "where": "H < 1 and not x > 6"}, ["t: 5"]),
        ({"value": "x", "at_least": 1, "where": "x < 4 or x == 7", "rows": "{case}"}, "not known of c$"),
        ({"value": "x", "at_least": 1, "where": "x < 4", "left_out": True, "rows": "{case}"}, ["d: 3"]),
        ({"value": "x", "at_least": 1, "where": "x < 3", "left_out": True}, "there is nothing"),
        ({"value": "x + y", "at_least": 1, "where": "x < 4", "left_out": True}, "not known of t$"),
        ({"value": "y", "at_least": 1}, "q is not known of t$"),
        ({"value": ["x", "2 * x"], "at_most": 1, "rows": "{variable}"}, ["x: 7", "2 * x: 14"]),
        ({"value": {"z": "x"}, "at_most": 1, "rows": "{case}, {variable}"}, ["d, z: 7", "c, z: 6"]),
        ({"value": "z / 2", "let": {"w": "x - 1", "z": "w * np.sqrt(4)"}, "at_least": 1}, ["t: 2"]),
    ],
)
def test_the_worst_value_of_an_expression_is_taken_over_all_rows(parameters, lines):
    """Over cases and sizes, of which one is not known; the scene's name is the table's if there is none."""
    check = partial(shared.worst, table="t", quantity="q", **parameters)
    if isinstance(lines, str):
        observes(check, MADE, lines)
    else:
        assert check(MADE).lines == [f"  {line}" for line in lines]


def test_values_along_a_ratio_are_those_of_the_pairs_with_it():
    """h = 1/2, 1/4, 1/8 and H = 1, 5/8, 1/2: H = 2h at (0, 0) and (1, 2), and nearly so elsewhere."""
    h = np.array([1 / 2, 1 / 4, 1 / 8])
    H = np.array([1, 5 / 8, 1 / 2])
    x = (("mesh", "partition"), np.arange(9.0).reshape(3, 3))
    pair_table = table(x=x, h_over_H=h[:, None] / H, H=H)
    check = partial(shared.worst, table="t", value="x", quantity="", H_over_h=2, at_least=0)
    assert check(pair_table, rows="{H:g}").lines == ["  1: 0", "  0.5: 5"]


def test_an_expression_without_a_bound_is_refused():
    table = xr.Dataset({"beta": ("mesh", [0.5])})
    with sentences.raises(InputError, "beta"):
        shared.worst({"a": table}, "a", "beta", "the smallest beta")


def test_parts_share_what_they_do_not_say_themselves():
    """3 is at least 2, and 7 is not at most 6; the first part is told if both hold."""
    check = partial(shared.all_of, table="t", value="x", quantity="q")
    for maximum, expected in ((6, (7, False)), (7, (3, True))):
        observes(
            partial(check, statements=[{"at_least": 2}, {"at_most": maximum, "quantity": "p"}]),
            MADE,
            expected,
        )
