"""The figure of sharpness: its table, and its numbers, and only those."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex

from examples import drawn_from, sharpness_table
from unilateral.study import tables
from unilateral.study.figures import sharpness
from unilateral.study.judge.surfaces import rates_over

NORMS = ("h1", "hm12", "l2", "consistency")


def markers(axes):
    """Where the measured markers stand, each with whether it is filled."""
    found = {}
    for line in axes.lines:
        if line.get_transform() != axes.transData and len(line.get_xdata()):
            filled = to_hex(line.get_markerfacecolor()) == to_hex(line.get_color())
            found |= {tuple(point): filled for point in np.round(line.get_xydata(), 9).tolist()}
    return found


def lines(axes):
    """The lines in the axes' data, point by point."""
    of_data = [line for line in axes.lines if line.get_transform() == axes.transData]
    return {tuple(map(tuple, np.round(np.asarray(line.get_xydata()), 9).tolist())) for line in of_data}


def test_every_rate_stands_over_its_alpha_and_is_filled_where_jj_holds(tmp_path, drawn):
    drawn_from("sharpness", tmp_path)
    for axes, norm in zip(drawn[0][0].axes, NORMS, strict=True):
        rows = sharpness_table().query(f"norm == '{norm}' and kind == 'measured'")
        places = [tuple(place) for place in rows[["alpha", "rate"]].round(9).to_numpy().tolist()]
        assert markers(axes) == dict(zip(places, rows["jj"] == 1, strict=True))
        assert markers(axes) != dict(zip(places, rows["jj"] == 0, strict=True))


def test_bars_reach_to_the_pair_before(tmp_path, drawn):
    drawn_from("sharpness", tmp_path)
    for axes, norm in zip(drawn[0][0].axes, NORMS, strict=True):
        rows = sharpness_table().query(f"norm == '{norm}' and kind == 'measured'")
        bars = [bar for bar in axes.collections if isinstance(bar, LineCollection)]
        ends = np.array([segment for bar in bars for segment in bar.get_segments()])
        found = {tuple(end) for end in np.column_stack([ends[:, 0, 0], ends[:, :, 1]]).round(9).tolist()}
        assert found == {tuple(x) for x in rows[["alpha", "rate", "before"]].round(9).to_numpy().tolist()}


def test_lines_are_those_of_the_table(tmp_path, drawn):
    drawn_from("sharpness", tmp_path)
    for axes, norm in zip(drawn[0][0].axes, NORMS, strict=True):
        rows = sharpness_table().query(f"norm == '{norm}' and kind != 'measured'")
        expected = {
            tuple(map(tuple, line[["alpha", "rate"]].round(9).to_numpy().tolist()))
            for _, line in rows.groupby(["kind", "gamma"], dropna=False)
        }
        assert lines(axes) == expected


def rates():
    """Rates alpha + 1 of everything on the last pair, and gamma before; (jj) fails for gamma = 1/2."""
    H, alpha, gamma = np.array([1 / 4, 1 / 8, 1 / 16]), [-0.25, 0.75], [0.5, 1.0]
    h, a, c, _ = np.ix_(H, alpha, gamma, [0.0])
    error = np.where(h == H[0], 2.0 ** (c - a - 1), 1.0) * h ** (a + 1)
    dims = ("level", "alpha", "gamma", "position")
    names = ("h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error", "consistency", "converged")
    table = {name: (dims, error) for name in (*names, "algebraic_bound")}
    per_level = {name: ("level", H) for name in ("h", "H", "beta_lower", "lambda_min")}
    return rates_over(xr.Dataset(table | per_level, coords={"alpha": alpha, "gamma": gamma}))


@pytest.fixture
def table(tmp_path):
    tables.save(rates(), tmp_path / "rates.nc", "sharpness")
    return sharpness.table(tmp_path / "rates.nc")


def test_the_table(table):
    assert set(table["norm"]) == set(NORMS)
    measured = table[table["kind"] == "measured"]
    assert len(measured) == 4 * 2 * 2
    np.testing.assert_allclose(measured["rate"], measured["alpha"] + 1, rtol=1e-12)
    np.testing.assert_allclose(measured["before"], measured["gamma"], rtol=1e-12)
    assert measured["jj"].tolist() == ((measured["gamma"] == 1) & (measured["alpha"] > 0)).tolist()


BENDS = {
    ("h1", "predicted"): [(-0.25, 0.75), (0, 1), (0.75, 1)],
    ("hm12", "predicted"): [(-0.25, 0.75), (0, 1), (0.5, 1.5), (0.75, 1.5)],
    ("l2", "predicted"): [(-0.25, 0.25), (0, 0.5), (0.5, 1), (0.75, 1)],
    ("h1", "left", 0.5): [(-0.25, 0.625), (0, 0.75), (0.5, 1), (0.75, 1)],
    ("hm12", "left", 1.0): [(-0.25, 0.75), (0, 1), (0.5, 1.25), (0.75, 1.375)],
    ("l2", "left", 0.5): [(-0.25, 0.125), (0, 0.25), (0.5, 0.5), (0.75, 0.625)],
    ("consistency", "predicted", 1.0): [(-0.25, 1.75), (0.75, 2.75)],
    ("consistency", "proved"): [(0, 2), (0.75, 2)],
    ("l2", "proved"): [(0, 0.5), (0.75, 0.5)],
    ("l2", "attained"): [(0, 0.5)],
    ("consistency", "attained"): [(0, 2)],
}


@pytest.mark.parametrize("line", BENDS, ids=str)
def test_lines_with_their_bends(line, table):
    """By hand, from min(1, 1 + alpha), min(3/2, 1 + alpha), min(1, alpha + 1/2) and alpha + gamma + 1."""
    rows = table[(table["norm"] == line[0]) & (table["kind"] == line[1])]
    if len(line) == 3:
        rows = rows[rows["gamma"] == line[2]]
    for alpha, rate in BENDS[line]:
        np.testing.assert_allclose(rows.loc[rows["alpha"] == alpha, "rate"].to_numpy(), [rate], rtol=1e-14)
    straight = np.interp(rows["alpha"], *np.transpose(BENDS[line]))
    np.testing.assert_allclose(rows["rate"], straight, rtol=1e-14)
