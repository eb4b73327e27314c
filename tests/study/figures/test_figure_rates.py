"""The figure of rates: its table from a made-up study, and its numbers."""

import numpy as np
import pytest
from conftest import texts

from examples import drawn_from, study_errors, study_rates
from unilateral.errors import InputError
from unilateral.study import tables
from unilateral.study.figures import rates


@pytest.fixture
def stored(tmp_path):
    """The tables of a made-up study: errors 12 h."""
    tables.save(study_errors(), tmp_path / "errors.nc", "scene")
    tables.save(study_rates(), tmp_path / "rates.nc", "scene")
    return tmp_path / "errors.nc", tmp_path / "rates.nc"


def test_the_table(stored):
    found = rates.table(*stored)
    levels = study_errors()["h"].values
    assert len(found) == 3 * 3
    for _, rows in found.groupby("norm"):
        assert rows["h"].tolist() == levels.tolist()
        assert rows["H"].tolist() == (2 * levels).tolist()
        np.testing.assert_allclose(rows["error"], 12 * levels, rtol=1e-15)
        assert rows["asymptotic"].tolist() == [0, 1, 1]
    same = {"scene": "scene", "case": "made_up", "h_over_H": 0.5, "rate": 0.9, "proved": 1.0, "expected": 1.5}
    for column, value in same.items():
        assert set(found[column]) == {value}


def test_a_study_without_levels_to_draw_is_refused(stored):
    tables.save(study_rates().assign_coords(h_over_H=[0.3]), stored[1], "scene")
    with pytest.raises(InputError, match=r"scene 'scene' has no level with h/H = 0\.3 to draw rates along"):
        rates.table(*stored)


def test_rates_are_those_of_the_table(tmp_path, drawn):
    """The table's rate, 7.77, is not the slope of its errors, 1.2: nothing is fitted here."""
    drawn_from("rates", tmp_path)
    said = [text.get_text() for text in texts(drawn[0][0])]
    assert said.count("7.77") == 2 * (3 + 1)  # two ratios; natural in three norms, no_contact in one
    assert said.count("–") == 2 * 2
    assert said.count("3.33") == 2 * 3
    assert said.count("no_contact: $\\lambda_H=0$ exactly") == 2
    assert not any("natural: " in text for text in said)
