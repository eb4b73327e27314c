"""The figure of sharpness and the table behind it: its numbers, and only those."""

from __future__ import annotations

import re
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import check_page, run_elsewhere
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from unilateral.errors import InputError
from unilateral.study import figures as plots
from unilateral.study.judge.surfaces import rates_over, sharpness_frame

NORMS = ("h1", "hm12", "l2", "consistency")
COLUMNS = ["kind", "norm", "alpha", "gamma", "rate", "before", "jj"]


def table() -> pd.DataFrame:
    """Two gammas, of which (jj) holds for one; rates of no law, so that none follows from others."""
    rows: list[list[Any]] = []
    for i, norm in enumerate(NORMS):
        for alpha, gamma in product((-0.25, 0.5, 1.75), (0.5, 1.5)):
            rate = 0.7 + 0.1 * i + 0.2 * alpha + 0.01 * gamma
            rows.append(["measured", norm, alpha, gamma, rate, rate - 0.05 * gamma, int(gamma > 1)])
        for kind, gamma, shift in (("predicted", np.nan, 0.03), ("left", 0.5, -0.04), ("left", 1.5, 0.0)):
            rows += [[kind, norm, a, gamma, 0.8 + 0.11 * a + shift, np.nan, np.nan] for a in (-0.25, 1.75)]
        rows += [["proved", norm, a, np.nan, 0.81, np.nan, np.nan] for a in (0.0, 1.75)]
        rows.append(["attained", norm, 0.0, np.nan, 0.81, np.nan, np.nan])
    return pd.DataFrame(rows, columns=COLUMNS)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table().to_csv(tmp_path / "sharpness.csv", index=False)
    return tmp_path


def draw(folder: Path, target: str = "figure.svg") -> bytes:
    plots.sharpness(folder / "sharpness.csv", folder / target)
    return (folder / target).read_bytes()


def markers(axes: Axes) -> dict[tuple[float, float], bool]:
    """Where the measured markers stand, each with whether it is filled."""
    found = {}
    for line in axes.lines:
        if line.get_transform() != axes.transData and len(line.get_xdata()):
            filled = to_hex(line.get_markerfacecolor()) == to_hex(line.get_color())
            found |= {tuple(point): filled for point in np.round(line.get_xydata(), 9).tolist()}
    return found


def lines(axes: Axes) -> set[tuple[tuple[float, float], ...]]:
    """The lines in the axes' data, point by point."""
    of_data = [line for line in axes.lines if line.get_transform() == axes.transData]
    return {tuple(map(tuple, np.round(np.asarray(line.get_xydata()), 9).tolist())) for line in of_data}


def test_the_same_table_gives_the_same_bytes(folder: Path) -> None:
    first = draw(folder)
    assert draw(folder, "again.svg") == first
    changed = table()
    changed.loc[1, "before"] += 0.05
    changed.to_csv(folder / "sharpness.csv", index=False)
    assert draw(folder) != first


def test_another_process_gives_the_same_bytes(folder: Path) -> None:
    first = draw(folder)
    program = "import sys\nfrom unilateral import plots\nplots.sharpness('sharpness.csv', 'figure.svg')"
    program += "\nassert 'matplotlib.pyplot' not in sys.modules"
    run_elsewhere(program, folder)
    assert (folder / "figure.svg").read_bytes() == first


def test_text_is_as_large_as_in_a_paper_and_on_the_page(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    svg = draw(folder).decode()
    assert not re.search(r"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    check_page(*drawn[0])


def test_every_rate_stands_over_its_alpha_and_is_filled_where_jj_holds(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw(folder)
    for axes, norm in zip(drawn[0][0].axes, NORMS, strict=True):
        rows = table().query(f"norm == '{norm}' and kind == 'measured'")
        places = [tuple(place) for place in rows[["alpha", "rate"]].round(9).to_numpy().tolist()]
        assert markers(axes) == dict(zip(places, rows["jj"] == 1, strict=True))
        assert markers(axes) != dict(zip(places, rows["jj"] == 0, strict=True))


def test_bars_reach_to_the_pair_before(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    draw(folder)
    for axes, norm in zip(drawn[0][0].axes, NORMS, strict=True):
        rows = table().query(f"norm == '{norm}' and kind == 'measured'")
        bars = [bar for bar in axes.collections if isinstance(bar, LineCollection)]
        ends = np.array([segment for bar in bars for segment in bar.get_segments()])
        found = {tuple(end) for end in np.column_stack([ends[:, 0, 0], ends[:, :, 1]]).round(9).tolist()}
        assert found == {tuple(x) for x in rows[["alpha", "rate", "before"]].round(9).to_numpy().tolist()}


def test_lines_are_those_of_the_table(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    draw(folder)
    for axes, norm in zip(drawn[0][0].axes, NORMS, strict=True):
        rows = table().query(f"norm == '{norm}' and kind != 'measured'")
        expected = {
            tuple(map(tuple, line[["alpha", "rate"]].round(9).to_numpy().tolist()))
            for _, line in rows.groupby(["kind", "gamma"], dropna=False)
        }
        assert lines(axes) == expected


@pytest.mark.parametrize("column", COLUMNS)
def test_a_missing_column_is_named_and_nothing_is_written(column: str, folder: Path) -> None:
    table().drop(columns=column).to_csv(folder / "sharpness.csv", index=False)
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match=rf"sharpness\.csv: the column '{column}' is missing"):
        draw(folder)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("kind", "guessed", "column 'kind': it has to hold all of measured, predicted"),
        ("norm", "h2", "column 'norm': it has to hold all of h1, hm12, l2, consistency"),
        ("rate", "fast", "column 'rate': all entries have to be numbers"),
    ],
)
def test_a_bad_entry_is_refused(column: str, value: object, message: str, folder: Path) -> None:
    spoilt = table().astype({column: object})
    spoilt.loc[1, column] = value
    spoilt.to_csv(folder / "sharpness.csv", index=False)
    with pytest.raises(InputError, match=rf"sharpness\.csv, {message}"):
        draw(folder)
    assert not (folder / "figure.svg").exists()


def rates() -> xr.Dataset:
    """Rates alpha + 1 of everything on the last pair, and gamma before; (jj) fails for gamma = 1/2."""
    H, alpha, gamma = np.array([1 / 4, 1 / 8, 1 / 16]), [-0.25, 0.75], [0.5, 1.0]
    h, a, c, _ = np.ix_(H, alpha, gamma, [0.0])
    error = np.where(h == H[0], 2.0 ** (c - a - 1), 1.0) * h ** (a + 1)
    dims = ("level", "alpha", "gamma", "position")
    names = ("h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error", "consistency", "converged")
    table = {name: (dims, error) for name in (*names, "algebraic_bound")}
    per_level = {name: ("level", H) for name in ("h", "H", "beta_lower", "lambda_min")}
    return rates_over(xr.Dataset(table | per_level, coords={"alpha": alpha, "gamma": gamma}))


def test_the_table_behind_the_figure() -> None:
    frame = sharpness_frame(rates())
    assert list(frame.columns) == COLUMNS
    assert set(frame["norm"]) == set(NORMS)
    measured = frame[frame["kind"] == "measured"]
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
def test_lines_with_their_bends(line: tuple) -> None:
    """By hand, from min(1, 1 + alpha), min(3/2, 1 + alpha), min(1, alpha + 1/2) and alpha + gamma + 1."""
    frame = sharpness_frame(rates())
    rows = frame[(frame["norm"] == line[0]) & (frame["kind"] == line[1])]
    if len(line) == 3:
        rows = rows[rows["gamma"] == line[2]]
    for alpha, rate in BENDS[line]:
        np.testing.assert_allclose(rows.loc[rows["alpha"] == alpha, "rate"].to_numpy(), [rate], rtol=1e-14)
    straight = np.interp(rows["alpha"], *np.transpose(BENDS[line]))
    np.testing.assert_allclose(rows["rate"], straight, rtol=1e-14)
