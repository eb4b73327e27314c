"""The figure of sharpness: its table, and its numbers, and only those."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from pages import lines, page, pairs, table

from unilateral.study import tables
from unilateral.study.experiments.sharpness import sharpness_figure as sharpness
from unilateral.study.experiments.sharpness.measure import MEASURED
from unilateral.study.experiments.sharpness.surfaces import rates_over

NORMS = ("discrete", "hm12", "l2", "consistency")


@pytest.fixture(params=range(4), ids=NORMS)
def panel(request):
    """The axes, with the rows of the table that belong to them: measured rates and lines."""
    rows = table("sharpness").query(f"norm == '{NORMS[request.param]}'")
    measured = rows["kind"] == "measured"
    return page("sharpness")[0].axes[request.param], rows[measured], rows[~measured]


def test_every_rate_stands_over_its_alpha_and_is_filled_where_jj_holds(panel):
    axes, rows, _ = panel
    found = set()
    for line in axes.lines:
        if line.get_transform() != axes.transData:
            filled = float(to_hex(line.get_markerfacecolor()) == to_hex(line.get_color()))
            found |= {(*point, filled) for point in np.round(line.get_xydata(), 9).tolist()}
    assert found == pairs(rows, "alpha", "rate", "jj")


def test_bars_reach_to_the_pair_before(panel):
    axes, rows, _ = panel
    bars = [bar for bar in axes.collections if isinstance(bar, LineCollection)]
    ends = np.array([segment for bar in bars for segment in bar.get_segments()]).reshape(-1, 2, 2)
    found = np.column_stack([ends[:, 0, 0], ends[:, :, 1]]).round(9).tolist()
    assert {tuple(end) for end in found} == pairs(rows, "alpha", "rate", "before")


def test_lines_are_those_of_the_table(panel):
    axes, _, rows = panel
    expected = [
        [tuple(point) for point in line[["alpha", "rate"]].round(9).to_numpy().tolist()]
        for _, line in rows.groupby(["kind", "gamma"], dropna=False)
    ]
    assert sorted(lines(axes)) == sorted(expected)


def rates():
    """Rates alpha + 1 of everything on the last pair, and gamma before; (jj) fails for gamma = 1/2."""
    H, alpha, gamma = np.array([1 / 4, 1 / 8, 1 / 16]), [-0.25, 0.75], [0.5, 1.0]
    h, a, c, _ = np.ix_(H, alpha, gamma, [0.0])
    error = np.where(h == H[0], 2.0 ** (c - a - 1), 1.0) * h ** (a + 1)
    dims = ("level", "alpha", "gamma", "position")
    found = {name: (dims, error) for name in MEASURED}
    per_level = {name: ("level", H) for name in ("h", "H", "beta_lower", "lambda_min")}
    return rates_over(xr.Dataset(found | per_level, coords={"alpha": alpha, "gamma": gamma}))


@pytest.fixture
def made_up(tmp_path):
    tables.save(rates(), tmp_path / "rates.nc", "sharpness")
    return sharpness.table(tmp_path / "rates.nc", tmp_path / "rates.nc")


def test_the_table(made_up):
    assert set(made_up["norm"]) == set(NORMS)
    measured = made_up[made_up["kind"] == "measured"]
    assert len(measured) == 4 * 2 * 2
    of_pairs, of_D = (measured[(measured["norm"] == "discrete") == D] for D in (False, True))
    np.testing.assert_allclose(of_pairs["rate"], of_pairs["alpha"] + 1, rtol=1e-12)
    np.testing.assert_allclose(of_pairs["before"], of_pairs["gamma"], rtol=1e-12)
    np.testing.assert_allclose(of_D["rate"], (of_D["alpha"] + 1 + of_D["gamma"]) / 2, rtol=1e-12)
    assert of_D["before"].isna().all()
    assert measured["jj"].tolist() == ((measured["gamma"] == 1) & (measured["alpha"] > 0)).tolist()


BENDS = {
    ("discrete", "predicted"): [(-0.25, 0.75), (0, 1), (0.5, 1.5), (0.75, 1.5)],
    ("hm12", "predicted"): [(-0.25, 0.75), (0, 1), (0.5, 1.5), (0.75, 1.5)],
    ("l2", "predicted"): [(-0.25, 0.25), (0, 0.5), (0.5, 1), (0.75, 1)],
    ("discrete", "left", 0.5): [(-0.25, 0.625), (0, 0.75), (0.5, 1), (0.75, 1.125)],
    ("discrete", "left", 1.0): [(-0.25, 0.75), (0, 1), (0.5, 1.25), (0.75, 1.375)],
    ("consistency", "predicted", 1.0): [(-0.25, 1.75), (0.75, 2.75)],
    ("consistency", "proved"): [(0, 2), (0.75, 2)],
    ("l2", "proved"): [(0, 0.5), (0.75, 0.5)],
    ("l2", "attained"): [(0, 0.5)],
    ("consistency", "attained"): [(0, 2)],
}


@pytest.mark.parametrize("line", BENDS, ids=str)
def test_lines_with_their_bends(line, made_up):
    """By hand, from min(3/2, 1 + alpha), min(1, alpha + 1/2), (1 + alpha + gamma)/2 and alpha + gamma + 1."""
    rows = made_up[(made_up["norm"] == line[0]) & (made_up["kind"] == line[1])]
    if len(line) == 3:
        rows = rows[rows["gamma"] == line[2]]
    for alpha, rate in BENDS[line]:
        np.testing.assert_allclose(rows.loc[rows["alpha"] == alpha, "rate"].to_numpy(), [rate], rtol=1e-14)
    straight = np.interp(rows["alpha"], *np.transpose(BENDS[line]))
    np.testing.assert_allclose(rows["rate"], straight, rtol=1e-14)
