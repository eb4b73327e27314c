"""The figure of the consistency term: its numbers, and only those."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import check_page, run_elsewhere, texts
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from matplotlib.transforms import Bbox

from unilateral.errors import InputError
from unilateral.study import figures as plots

COLUMNS = ["kind", "case", "H", "s", "end", "lambda_mean", "gap_mean", "term", "over_H2", "theta", "rate"]
MEANS = {"lambda_mean": [0, 0.3, 0.7, 0.2], "gap_mean": [0.4, 0.1, 0, 0.5]}
TERMS = [0, 3e-5, 0, 2e-8]


def table() -> pd.DataFrame:
    """Terms of no law, so that none follows from others; theta alternates."""
    cells = pd.DataFrame({"s": np.arange(4) / 4, "end": np.arange(1, 5) / 4, "term": TERMS} | MEANS)
    rows: list[dict[str, Any]] = []
    for i, case in enumerate(("steep", "flat")):
        for k, H in enumerate((0.25, 0.125, 0.0625)):
            same = {"case": case, "H": H, "theta": (k % 2 + 1) / 3, "rate": 3 - i}
            terms = {"total": 0.01 * H**2 * (i + 1.1), "elsewhere": 0.0, "predicted": 0.013 * H ** (2.5 - i)}
            rows += [{"kind": kind, **same, "term": x, "over_H2": 7 * x} for kind, x in terms.items()]
    return pd.concat([cells.assign(kind="cell", case="steep", H=0.25), pd.DataFrame(rows)])[COLUMNS]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    table().to_csv(tmp_path / "consistency.csv", index=False)
    return tmp_path


def draw(folder: Path, target: str = "figure.svg") -> bytes:
    plots.consistency(folder / "consistency.csv", folder / target)
    return (folder / target).read_bytes()


def of_data(axes: Axes, markers: bool) -> list[list[tuple[float, float]]]:
    """The lines of the axes' data, point by point, with or without markers."""
    drawn = [line for line in axes.lines if line.get_transform() == axes.transData]
    with_them = [line for line in drawn if (line.get_marker() not in ("None", "")) == markers]
    return [list(map(tuple, np.asarray(line.get_xydata()).tolist())) for line in with_them]


def test_the_same_table_gives_the_same_bytes(folder: Path) -> None:
    first = draw(folder)
    assert draw(folder, "again.svg") == first
    changed = table().reset_index(drop=True)
    changed.loc[1, "term"] *= 1.5
    changed.to_csv(folder / "consistency.csv", index=False)
    assert draw(folder) != first


def test_another_process_gives_the_same_bytes(folder: Path) -> None:
    first = draw(folder)
    program = "import sys\nfrom unilateral import plots\nplots.consistency('consistency.csv', 'figure.svg')"
    program += "\nassert 'matplotlib.pyplot' not in sys.modules"
    run_elsewhere(program, folder)
    assert (folder / "figure.svg").read_bytes() == first


def test_text_is_as_large_as_in_a_paper_and_on_the_page(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    svg = draw(folder).decode()
    assert not re.search(r"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    check_page(*drawn[0])


def test_both_means_stand_on_their_cells(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    draw(folder)
    steps = [patch.get_data() for patch in drawn[0][0].axes[0].patches if isinstance(patch, StepPatch)]
    assert all(step.edges.tolist() == [0, 0.25, 0.5, 0.75, 1] for step in steps)
    assert {tuple(step.values) for step in steps} == {tuple(means) for means in MEANS.values()}


def test_every_cell_s_term_is_marked_and_zeros_stand_at_the_foot(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw(folder)
    axes = drawn[0][0].axes[1]
    positive, zero = of_data(axes, markers=True)
    assert positive == [(0.375, 3e-5), (0.875, 2e-8)]
    foot = axes.get_ylim()[0]
    assert zero == [(0.125, foot), (0.625, foot)]
    assert foot < 2e-8
    assert axes.get_yticklabels()[0].get_text() == "$0$"
    grey = sorted(patch.get_bbox().x0 for patch in axes.patches)
    assert grey == [0.25, 0.75]


def test_totals_are_marked_and_what_is_predicted_is_a_line_per_theta(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw(folder)
    axes = drawn[0][0].axes[2]
    for kind, markers in (("total", True), ("predicted", False)):
        rows = table().query(f"kind == '{kind}'").sort_values("H")
        groups = [part for _, part in rows.groupby(["case", "theta"])]
        expected = [list(zip(part["H"], part["over_H2"], strict=True)) for part in groups]
        for line, found in zip(sorted(expected), sorted(of_data(axes, markers)), strict=True):
            np.testing.assert_allclose(found, line, rtol=1e-12)
    marked = [line for line in axes.lines if line.get_marker() not in ("None", "")]
    filled = {
        round(float(x), 9): to_hex(line.get_markerfacecolor()) == to_hex(line.get_color())
        for line in marked
        for x in np.asarray(line.get_xdata())
    }
    assert filled == {0.25: True, 0.125: False, 0.0625: True}


@pytest.mark.parametrize(("elsewhere", "said"), [(0.0, "the term is 0,"), (3e-7, "the term is 3e-07,")])
def test_what_other_cells_add_is_said(
    elsewhere: float, said: str, folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    changed = table().reset_index(drop=True)
    changed.loc[changed.index[changed["kind"] == "elsewhere"][2], "term"] = elsewhere
    changed.to_csv(folder / "consistency.csv", index=False)
    draw(folder)
    assert any(said in text.get_text() for text in texts(drawn[0][0]))


def test_cases_are_named_with_their_powers(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    draw(folder)
    names = [text.get_text() for text in drawn[0][0].legends[0].get_texts()]
    assert names == ["flat: $H^{2}$", "steep: $H^{3}$"]


@pytest.mark.parametrize("column", COLUMNS)
def test_a_missing_column_is_named_and_nothing_is_written(column: str, folder: Path) -> None:
    table().drop(columns=column).to_csv(folder / "consistency.csv", index=False)
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match=rf"consistency\.csv: the column '{column}' is missing"):
        draw(folder)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("kind", "guessed", "column 'kind': it has to hold all of cell, total"),
        ("term", "small", "column 'term': all entries have to be numbers"),
    ],
)
def test_a_bad_entry_is_refused(column: str, value: object, message: str, folder: Path) -> None:
    spoilt = table().reset_index(drop=True).astype({column: object})
    spoilt.loc[1, column] = value
    spoilt.to_csv(folder / "consistency.csv", index=False)
    with pytest.raises(InputError, match=rf"consistency\.csv, {message}"):
        draw(folder)
    assert not (folder / "figure.svg").exists()
