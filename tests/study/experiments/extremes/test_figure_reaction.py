"""The figure of the bounds over c/k: a panel per case, a line per bound and mesh."""

import numpy as np
import pandas as pd
import pytest
from pages import drawn, faults, lines, said

from study.experiments.extremes import reaction_figure
from study.experiments.extremes.reaction import REACTION_CASES, survey_reaction
from study.tables import save_table


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """The table of a small survey, and its file."""
    path = tmp_path_factory.mktemp("extremes") / "reaction.nc"
    table = survey_reaction({"h": ["1/4", "1/8"], "c_over_k": [1e-30, 1, 1e4]})
    save_table(table, path, "extremes")
    return table, path


def test_the_rows_are_the_points_but_those_of_c_0(stored):
    table, path = stored
    rows = reaction_figure.table(path)
    assert len(rows) == 2 * 4 * 2 * 3
    for bound in ("cheap", "sharp"):
        index = (table[f"{bound}_bound"] / table["energy_error"]).isel(c_over_k=slice(1, None))
        np.testing.assert_array_equal(rows.loc[rows["bound"] == bound, "index"], index.values.ravel())
    np.testing.assert_allclose(rows["log10_value"].unique(), [-30, 0, 4])


def test_every_line_is_that_of_a_bound_on_a_mesh(stored):
    rows = reaction_figure.table(stored[1])
    figure = drawn("reaction", rows)[0]
    assert faults(figure) == []
    assert {"$h=1/4$", "$h=1/8$", "cheap bound", "sharp bound"} <= set(said(figure))
    for axes, case in zip(figure.axes, REACTION_CASES, strict=True):
        assert axes.get_title() == case
        of_case = rows[rows["case"] == case]
        expected = [
            [tuple(point) for point in line[["log10_value", "index"]].round(9).to_numpy().tolist()]
            for _, line in of_case.groupby(["bound", "h"], sort=False)
        ]
        assert lines(axes) == expected
        low, high = axes.get_ylim()
        assert low < 1 <= rows["index"].min()
        assert rows["index"].max() < high


def test_another_table_gives_another_figure(stored):
    """Control."""
    rows = reaction_figure.table(stored[1])
    changed = pd.concat([rows.iloc[:1].assign(index=3.0), rows.iloc[1:]])
    assert drawn("reaction", rows)[1] != drawn("reaction", changed)[1]
