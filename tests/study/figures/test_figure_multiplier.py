"""The figure of the worst multipliers: their table from a made-up survey, and its numbers."""

import numpy as np
import pytest
import xarray as xr
from conftest import texts
from matplotlib.patches import StepPatch

from examples import drawn_from, multiplier_table
from unilateral.errors import InputError
from unilateral.study import tables
from unilateral.study.figures import multiplier


@pytest.fixture
def survey(tmp_path):
    """Two meshes; of the first partition, which is drawn, three cells, and four of the second."""
    of_both = ("mesh", "partition")
    points = np.array([[0, 1, 2, 4, np.nan], [0, 1, 2, 3, 4]])
    values = {
        "h_over_H": (of_both, np.array([[0.5, 0.4], [0.8, 0.6]])),
        "beta_lower": (of_both, np.array([[0.6, 0], [0.2, 0]])),
        "beta_upper": (of_both, np.array([[0.7, 0], [0.3, 0]])),
        "points": (("partition", "point"), points),
        "side": (("partition", "cell"), np.array([[0, 1, 2, np.nan], [0, 1, 2, 3]])),
        "worst": ((*of_both, "cell"), np.arange(16.0).reshape(2, 2, 4)),
    }
    tables.save(xr.Dataset(values), tmp_path / "infsup.nc", "survey")
    return tmp_path / "infsup.nc"


def test_the_table(survey):
    found = multiplier.table(survey, ["4/5", "1/2"])
    assert found["h_over_H"].tolist() == [0.8] * 3 + [0.5] * 3
    assert found["beta"].tolist() == pytest.approx([0.25] * 3 + [0.65] * 3)
    assert found["mu"].tolist() == [8, 9, 10, 0, 1, 2]
    assert found[["side", "s", "end"]].to_numpy().tolist() == 2 * [[0, 0, 1], [1, 1, 2], [2, 2, 4]]


def test_a_ratio_that_the_survey_does_not_have_is_refused(survey):
    with pytest.raises(InputError, match=r"survey 'survey' has no mesh with h/H = 0\.25 to draw"):
        multiplier.table(survey, ["1/4"])


def test_multipliers_and_their_beta_are_those_of_the_table(tmp_path, drawn):
    drawn_from("multiplier", tmp_path)
    page, table = drawn[0][0], multiplier_table()
    said = [text.get_text() for text in texts(page)]
    assert [text for text in said if "beta" in text] == ["$h/H=4/5$\n$\\beta=0.549$", "$h/H=1$\n$\\beta=0$"]
    assert [text for text in said if text in ("bottom", "right", "top", "left")] == [
        "bottom",
        "right",
        "top",
        "left",
    ]
    for axes, ratio in zip(page.axes, (0.8, 1.0), strict=True):
        outline = [patch for patch in axes.patches if isinstance(patch, StepPatch)][-1]
        values, edges, _ = outline.get_data()
        of_ratio = table[table["h_over_H"] == ratio]
        assert values == pytest.approx(of_ratio["mu"].to_numpy(), rel=1e-12)
        assert edges == pytest.approx([*of_ratio["s"], 4.0])
        others = table.loc[table["h_over_H"] != ratio, "mu"].to_numpy()
        assert values != pytest.approx(others, rel=1e-12)
