"""The figure of sharpness: its table, and its numbers, and only those."""

import numpy as np
import pytest
import xarray as xr
from pages import page, table

from study import tables
from study.experiments.sharpness import sharpness_figure as sharpness
from study.experiments.sharpness.surfaces import tabulate_surfaces

NORMS = ("discrete", "hm12", "l2")
VARIABLES = (
    *("h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error", "discrete_error"),
    *("ritz_means", "held", "consistency", "algebraic_bound", "converged"),
)


@pytest.mark.parametrize("norm", NORMS)
def test_a_panel_has_the_lines_of_its_rows_and_no_others(norm):
    """Measured rates are a line for each alpha, all other kinds are one line each."""
    rows = table("sharpness").query(f"norm == '{norm}'")
    components = rows.assign(of=rows["alpha"].where(rows["kind"] == "measured", 0)).groupby(["kind", "of"])
    expected = [line[["alpha", "rate"]].round(9).to_numpy().tolist() for _, line in components]
    computed = [
        line.get_xydata().round(9).tolist() for line in page("sharpness")[0].axes[NORMS.index(norm)].lines
    ]
    assert sorted(computed) == sorted(expected)


def rates():
    """Rates alpha + 1 of everything on the last pair, and gamma before; (jj) fails for gamma = 1/2."""
    H = np.array([1 / 4, 1 / 8, 1 / 16])
    alpha = [-0.25, 0.75]
    gamma = [0.5, 1.0]
    h, a, c, _ = np.ix_(H, alpha, gamma, [0.0])
    error = np.where(h == H[0], 2.0 ** (c - a - 1), 1.0) * h ** (a + 1)
    dims = ("level", "alpha", "gamma", "position")
    errors_by_variable = {name: (dims, error) for name in VARIABLES}
    per_level = {name: ("level", H) for name in ("h", "H", "beta_lower", "lambda_min")}
    return tabulate_surfaces(
        xr.Dataset(errors_by_variable | per_level, coords={"alpha": alpha, "gamma": gamma})
    )


@pytest.fixture
def made_up(tmp_path):
    tables.save_table(rates(), tmp_path / "rates.nc", "sharpness")
    return sharpness.table(tmp_path / "rates.nc", tmp_path / "rates.nc")


def test_the_table_has_measured_and_largest_rates_per_norm(made_up):
    """The largest error is for the larger gamma on the coarsest level, and the same for both after it."""
    assert set(made_up["norm"]) == set(NORMS)
    measured = made_up[made_up["kind"] == "measured"]
    largest = made_up[made_up["kind"] == "largest"]
    assert (len(measured), len(largest)) == (3 * 2 * 2, 2 * 2)
    pair_rows = measured[measured["norm"] != "discrete"]
    discrete_rows = measured[measured["norm"] == "discrete"]
    for rows in (pair_rows, largest):
        np.testing.assert_allclose(rows["rate"], rows["alpha"] + 1, rtol=1e-12)
    np.testing.assert_allclose(
        discrete_rows["rate"], (discrete_rows["alpha"] + 1 + discrete_rows["gamma"]) / 2, rtol=1e-12
    )


BENDS = {
    ("discrete", "predicted"): [(-0.25, 0.75), (0, 1), (0.5, 1.5), (0.75, 1.5)],
    ("hm12", "predicted"): [(-0.25, 0.75), (0, 1), (0.5, 1.5), (0.75, 1.5)],
    ("l2", "predicted"): [(-0.25, 0.25), (0, 0.5), (0.5, 1), (0.75, 1)],
    ("discrete", "left", 0.5): [(-0.25, 0.625), (0, 0.75), (0.5, 1), (0.75, 1.125)],
    ("l2", "proved"): [(0, 0.5), (0.75, 0.5)],
}


@pytest.mark.parametrize("line", BENDS, ids=str)
def test_lines_bend_where_the_smaller_of_two_rates_changes(line, made_up):
    """By hand: min(3/2, 1 + alpha), min(1, alpha + 1/2), and (1 + alpha + gamma)/2 for the least gamma."""
    rows = made_up[(made_up["norm"] == line[0]) & (made_up["kind"] == line[1])]
    if len(line) == 3:
        rows = rows[rows["gamma"] == line[2]]
    for alpha, rate in BENDS[line]:
        np.testing.assert_allclose(rows.loc[rows["alpha"] == alpha, "rate"].to_numpy(), [rate], rtol=1e-14)
    straight = np.interp(rows["alpha"], *np.transpose(BENDS[line]))
    np.testing.assert_allclose(rows["rate"], straight, rtol=1e-14)
