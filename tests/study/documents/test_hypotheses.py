"""The table of the hypotheses: its words are filled with numbers, and only with those that there are."""

import re

import pytest

from unilateral.study.documents import hypotheses

NUMBERS = {
    "violates_j": 0.111,
    "violates_jj": 0.222,
    "cantor": 0.333,
    "alternating": 0.888,
    "violates_jj_jjj": 0.444,
    "proved": 0.552,
    "uniform": 0.6667,
    "local": 0.7779,
}


def test_every_number_stands_in_its_row_and_no_other():
    """By hand; that of beta, which is a lower bound, is rounded down."""
    rows = hypotheses.table(NUMBERS)["shown by"]
    found = [re.findall(r"0\.\d+", row) for row in rows]
    assert found == [["0.11"], ["0.22"], ["0.33"], ["0.89", "0.44", "0.55"], ["0.66"], [], [], ["0.77"]]


def test_every_hypothesis_of_1980_has_a_full_row():
    table = hypotheses.table(NUMBERS)
    for name in ("(j):", "(jj):", "(jjj):", "h/H small", "L^2", "vertices", "H_i"):
        assert table["hypothesis"].str.contains(name, regex=False).any(), name
    assert (table != "").all(axis=None)
    assert not table.map(lambda words: "<" in words and ">" in words).any(axis=None)


def test_a_number_that_there_is_not_is_noticed():
    """Control."""
    with pytest.raises(KeyError, match="cantor"):
        hypotheses.table({name: value for name, value in NUMBERS.items() if name != "cantor"})
