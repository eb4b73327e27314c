"""The figure of where it breaks: its points, their marks, and only those."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import check_page, run_elsewhere
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from unilateral.errors import InputError
from unilateral.study import figures as plots
from unilateral.study.figures.extremes import KINDS

COLUMNS = ["label", "kind", "log10_value", "log10_limit", "log10_tool_limit"]


def table() -> pd.DataFrame:
    """An axis downwards with two limits, one upwards without; all kinds, and two points near each other."""
    down = [
        ["size", kind, -1.5 * k, -2.0, -4.0] for k, kind in enumerate(["right", "right", *list(KINDS)[1:]])
    ]
    up = [["rho", "right", x, np.nan, np.nan] for x in (-0.3, -0.0004, 0.0004, 0.3)]
    return pd.DataFrame(down + up, columns=COLUMNS)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table().to_csv(tmp_path / "extremes.csv", index=False)
    return tmp_path


def draw(folder: Path, target: str = "figure.svg") -> bytes:
    plots.extremes(folder / "extremes.csv", folder / target)
    return (folder / target).read_bytes()


def test_the_same_table_gives_the_same_bytes(folder: Path) -> None:
    first = draw(folder)
    assert draw(folder, "again.svg") == first
    program = "import sys\nfrom unilateral import plots\nplots.extremes('extremes.csv', 'other.svg')"
    program += "\nassert 'matplotlib.pyplot' not in sys.modules"
    run_elsewhere(program, folder)
    assert (folder / "other.svg").read_bytes() == first
    changed = table()
    changed.loc[1, "log10_value"] -= 0.5
    changed.to_csv(folder / "extremes.csv", index=False)
    assert draw(folder) != first


def test_text_is_as_large_as_in_a_paper_and_on_the_page(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    svg = draw(folder).decode()
    assert not re.search(r"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    check_page(*drawn[0])


def test_every_point_stands_at_its_value_with_its_mark(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw(folder)
    strips = drawn[0][0].axes
    assert [strip.get_title(loc="left") for strip in strips] == ["size", "rho"]
    for strip, (_, of) in zip(strips, table().groupby("label", sort=False), strict=True):
        found = {
            (round(float(x), 9), line.get_marker())
            for line in strip.lines
            for x in np.atleast_1d(line.get_xdata())
            if line.get_marker() != "None"
        }
        assert found == {
            (round(x, 9), KINDS[kind][0]) for x, kind in zip(of["log10_value"], of["kind"], strict=True)
        }


def test_mild_is_left_and_limits_are_where_they_are_predicted(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw(folder)
    size, rho = drawn[0][0].axes
    assert size.xaxis_inverted()
    assert not rho.xaxis_inverted()
    upright = [{float(x) for x in line.get_xdata()} for line in size.lines if line.get_marker() == "None"]
    assert {-2.0} in upright
    assert {-4.0} in upright
    assert len([line for line in rho.lines if line.get_marker() == "None"]) == 1


def test_near_points_are_drawn_apart(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    draw(folder)
    rho = drawn[0][0].axes[1]
    points = next(
        line.get_xydata() for line in rho.lines if line.get_marker() == "o" and len(line.get_xdata())
    )
    heights = dict(np.round(np.asarray(points), 6).tolist())
    assert heights[-0.0004] * heights[0.0004] < 0
    assert heights[-0.3] == heights[0.3] == 0


def test_what_broke_is_below_what_is_right_near_it(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    """Three points near a limit, the first of which is right; and ticks are round powers of 10."""
    start = ["start", "right", 0.0, 299.7, np.nan]
    near = [["start", kind, x, 299.7, np.nan] for kind, x in (("right", 299.6), *2 * [("refused", 299.8)])]
    pd.DataFrame([start, *near], columns=COLUMNS).to_csv(folder / "extremes.csv", index=False)
    draw(folder)
    strip = drawn[0][0].axes[0]
    heights = {
        (line.get_marker(), round(float(x), 1)): y
        for line in strip.lines
        if line.get_marker() in ("o", "s")
        for x, y in np.asarray(line.get_xydata()).tolist()
    }
    assert heights == {("o", 0.0): 0.0, ("o", 299.6): 0.5, ("s", 299.8): -0.5}
    assert strip.get_xticks().tolist() == [0, 50, 100, 150, 200, 250]


@pytest.mark.parametrize("column", COLUMNS)
def test_a_missing_column_is_named(column: str, folder: Path) -> None:
    table().drop(columns=column).to_csv(folder / "extremes.csv", index=False)
    with pytest.raises(InputError, match=f"the column '{column}' is missing"):
        draw(folder)
    assert not (folder / "figure.svg").exists()


def test_an_unknown_kind_is_named(folder: Path) -> None:
    table().replace({"kind": {"refused": "denied"}}).to_csv(folder / "extremes.csv", index=False)
    with pytest.raises(InputError, match="column 'kind': 'denied' is none of right"):
        draw(folder)
