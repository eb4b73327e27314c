"""The figure of the bounds over c/k: a panel per case, a line per bound and mesh."""

import numpy as np
import pandas as pd
import pytest
from pages import draw_page, faults, lines, list_texts

from study.experiments.extremes import reaction_figure
from study.experiments.extremes.reaction import REACTION_CASES, survey_reaction
from study.tables import save_table


@pytest.fixture(scope="module")
def small_survey(tmp_path_factory):
    """The table of a small survey, and its file."""
    path = tmp_path_factory.mktemp("extremes") / "reaction.nc"
    table = survey_reaction({"h": ["1/4", "1/8"], "c_over_k": [1e-30, 1, 1e4]})
    save_table(table, path, "extremes")
    return table, path


def test_the_rows_are_the_points_but_those_of_c_0(small_survey):
    table, path = small_survey
    rows = reaction_figure.table(path)
    assert len(rows) == 2 * 4 * 2 * 3
    for bound in ("cheap", "sharp"):
        index = (table[f"{bound}_bound"] / table["energy_error"]).isel(c_over_k=slice(1, None))
        np.testing.assert_array_equal(rows.loc[rows["bound"] == bound, "index"], index.values.ravel())
    np.testing.assert_allclose(rows["log10_value"].unique(), [-30, 0, 4])


def test_every_line_is_that_of_a_bound_on_a_mesh(small_survey):
    rows = reaction_figure.table(small_survey[1])
    figure = draw_page("reaction", rows)[0]
    assert faults(figure) == []
    assert {"$h=1/4$", "$h=1/8$", "cheap bound", "sharp bound"} <= set(list_texts(figure))
    for axes, case in zip(figure.axes, REACTION_CASES, strict=True):
        assert axes.get_title() == case
        case_rows = rows[rows["case"] == case]
        expected = [
            [tuple(point) for point in line[["log10_value", "index"]].round(9).to_numpy().tolist()]
            for _, line in case_rows.groupby(["bound", "h"], sort=False)
        ]
        assert lines(axes) == expected
        low, high = axes.get_ylim()
        assert low < 1 <= rows["index"].min()
        assert rows["index"].max() < high


def test_another_table_gives_another_figure(small_survey):
    """Control."""
    rows = reaction_figure.table(small_survey[1])
    changed = pd.concat([rows.iloc[:1].assign(index=3.0), rows.iloc[1:]])
    assert draw_page("reaction", rows)[1] != draw_page("reaction", changed)[1]
