"""The figure of the worst multipliers: their table from a made-up survey, and its numbers."""

import numpy as np
import pandas as pd
import pytest
import sentences
import xarray as xr
from matplotlib.patches import StepPatch
from pages import draw_page, list_texts, page, table

from study import tables
from study.experiments.stability import multiplier_figure as multiplier
from unilateral.errors import InputError


@pytest.fixture
def survey(tmp_path):
    """Two meshes; of the first partition, which is drawn, three cells, and four of the second."""
    keys = ("mesh", "partition")
    values = {
        "h_over_H": (keys, np.array([[0.5, 0.4], [0.8, 0.6]])),
        "beta_lower": (keys, np.array([[0.6, 0], [0.2, 0]])),
        "beta_upper": (keys, np.array([[0.7, 0], [0.3, 0]])),
        "points": (("partition", "point"), np.array([[0, 1, 2, 4, np.nan], [0, 1, 2, 3, 4]])),
        "side": (("partition", "cell"), np.array([[0, 1, 2, np.nan], [0, 1, 2, 3]])),
        "worst": ((*keys, "cell"), np.arange(16.0).reshape(2, 2, 4)),
    }
    tables.save_table(xr.Dataset(values), tmp_path / "infsup.nc", "survey")
    return tmp_path / "infsup.nc"


def test_the_table_has_the_multiplier_of_each_cell_and_beta(survey):
    table = multiplier.table(survey, ["4/5", "1/2"])
    assert table["h_over_H"].tolist() == [0.8] * 3 + [0.5] * 3
    assert table["beta"].tolist() == pytest.approx([0.25] * 3 + [0.65] * 3)
    assert table["mu"].tolist() == [8, 9, 10, 0, 1, 2]
    assert table[["side", "s", "end"]].to_numpy().tolist() == 2 * [[0, 0, 1], [1, 1, 2], [2, 2, 4]]


def test_a_ratio_that_the_survey_does_not_have_is_refused(survey):
    with sentences.raises(InputError):
        multiplier.table(survey, ["1/4"])


def test_multipliers_and_their_beta_are_those_of_the_table():
    figure = page("multiplier")[0]
    rows = table("multiplier")
    texts = list_texts(figure)
    ratios = sorted(rows["h_over_H"].unique())
    betas = [rows["beta"][rows["h_over_H"] == ratio].iloc[0] for ratio in ratios]
    partitions = [text.partition("\n")[2] for text in texts if "beta" in text]
    assert partitions == [rf"$\beta={beta:.3f}$" if beta else r"$\beta=0$" for beta in betas]
    names = [f"side {side}" for side in range(4)]
    assert [text for text in texts if text.startswith("side")] == names
    for axes, ratio in zip(figure.axes, ratios, strict=True):
        outline = [patch for patch in axes.patches if isinstance(patch, StepPatch)][-1]
        values, edges, _ = outline.get_data()
        ratio_rows = rows[rows["h_over_H"] == ratio]
        assert values == pytest.approx(ratio_rows["mu"].to_numpy(), rel=1e-12)
        assert edges == pytest.approx([*ratio_rows["s"], 4.0])


def test_a_polygon_with_other_sides_is_drawn_with_all_of_them():
    """An L-shape has six, of which the longest are twice as long."""
    ends = np.array([0, 1, 2, 3, 4, 6, 8])
    rows = pd.DataFrame({"h_over_H": 0.5, "beta": 0.7, "side": range(6), "s": ends[:-1], "end": ends[1:]})
    figure, _ = draw_page("multiplier", rows.assign(mu=[1, -1, 1, -1, 1, -1]))
    assert [text for text in list_texts(figure) if text.startswith("side")] == [f"side {k}" for k in range(6)]
    assert figure.axes[0].get_xlim() == (0, 8)
