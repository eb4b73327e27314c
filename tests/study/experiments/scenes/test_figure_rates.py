"""The figure of rates: its table from a made-up study, and its numbers."""

import re

import numpy as np
import pytest
import sentences
import xarray as xr
from matplotlib.ticker import NullFormatter
from pages import LEVELS, draw_page, list_texts, page, read_committed_table, study_errors, table

from study import tables
from study.experiments.scenes import rates_figure as rates
from unilateral.errors import InputError


def study_rates():
    """Rates along H = 2 h, of which the finest pair is asymptotic."""
    index = ("case", "norm", "h_over_H")
    first = {"fitted": 0.9, "proved": 1.0, "expected": 1.5}
    pair = {"h_coarse": LEVELS[:2], "h_fine": LEVELS[1:], "asymptotic": [0.0, 1.0]}
    values = {name: (index, np.full((1, 3, 1), value)) for name, value in first.items()}
    values |= {name: ((*index, "pair"), np.broadcast_to(x, (1, 3, 1, 2))) for name, x in pair.items()}
    return xr.Dataset(values, {"case": ["made_up"], "norm": ["h1", "hm12", "l2"], "h_over_H": [0.5]})


@pytest.fixture
def made_up_study(tmp_path):
    """The tables of a made-up study: errors 12 h."""
    tables.save_table(study_errors(), tmp_path / "errors.nc", "scene")
    tables.save_table(study_rates(), tmp_path / "rates.nc", "scene")
    return tmp_path / "errors.nc", tmp_path / "rates.nc"


def test_the_table_has_errors_over_h_at_one_ratio_with_their_rates(made_up_study):
    table = rates.table(*made_up_study)
    assert len(table) == 3 * 3
    for _, rows in table.groupby("norm"):
        assert rows["h"].tolist() == LEVELS.tolist()
        assert rows["H"].tolist() == (2 * LEVELS).tolist()
        np.testing.assert_allclose(rows["error"], 12 * LEVELS, rtol=1e-15)
        assert rows["asymptotic"].tolist() == [0, 1, 1]
    same = {"scene": "scene", "case": "made_up", "h_over_H": 0.5, "rate": 0.9, "proved": 1.0, "expected": 1.5}
    for column, value in same.items():
        assert set(table[column]) == {value}


def test_a_ratio_at_which_nothing_was_solved_is_left_out(made_up_study):
    """The study has levels with h/H = 1, 1/2 and 1/4, and runs for the first two."""
    ratios = [1.0, 0.5, 0.25]
    several = xr.concat([study_rates().assign_coords(h_over_H=[ratio]) for ratio in ratios], "h_over_H")
    tables.save_table(several, made_up_study[1], "scene")
    assert set(study_errors()["h_over_H"].values.flat) >= set(ratios)
    assert set(rates.table(*made_up_study)["h_over_H"]) == {1.0, 0.5}


def test_a_study_without_levels_to_draw_is_refused(made_up_study):
    tables.save_table(study_rates().assign_coords(h_over_H=[0.3]), made_up_study[1], "scene")
    with sentences.raises(InputError):
        rates.table(*made_up_study)


def test_rates_are_those_of_the_table():
    """The table's rates are not the slopes of its errors: nothing is fitted here."""
    texts = list_texts(page("rates")[0])
    rows = table("rates")
    runs = rows.groupby(["case", "norm", "h_over_H"])["rate"].first()
    expected = rows.groupby(["case", "norm"])["expected"].first()
    numbers = [f"{x:.2f}" for x in [*runs, *expected] if np.isfinite(x)]
    assert sorted(t for t in texts if re.fullmatch(r"\d\.\d\d", t)) == sorted(numbers)
    assert texts.count("exact") == 2
    assert texts.count("no_contact: $\\lambda_H=0$ exactly") == 2
    assert not any("natural: " in text for text in texts)


@pytest.mark.parametrize(
    ("errors", "why"), [(np.nan, "error not computed"), (0.0, "exact"), (0.5, "no asymptotic level")]
)
def test_a_case_without_a_rate_says_why(errors, why):
    """Of one case among others the rates are taken away."""
    rows = read_committed_table("rates")
    case = (rows["case"] == "smooth") & (rows["norm"] == "l2")
    rows.loc[case, ["error", "rate", "expected"]] = [errors, np.nan, np.nan]
    before = list_texts(page("rates")[0])
    after = list_texts(draw_page("rates", rows)[0])
    assert after.count(why) == before.count(why) + 1


@pytest.mark.parametrize("share", [1.0, 0.01])
def test_every_panel_has_two_powers_of_ten_and_labels_at_no_other_number(share):
    """Labels such as 6 x 10^-4 would reach into the next panel; `share` squeezes the errors' exponents."""
    rows = read_committed_table("rates")
    rows["error"] = 3e-4 * (rows["error"] / rows["error"].max()) ** share
    for axes in draw_page("rates", rows)[0].axes[1:]:
        low, high = np.log10(axes.get_ylim())
        assert np.floor(high + 1e-9) - np.ceil(low - 1e-9) >= 1
        assert isinstance(axes.yaxis.get_minor_formatter(), NullFormatter)
