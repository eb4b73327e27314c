"""The figures of the inf-sup constant and of the dual norm: the numbers of their tables, and only those."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import check_page, run_elsewhere, texts
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from matplotlib.transforms import Bbox

from unilateral.errors import InputError
from unilateral.study import figures as plots


def infsup_table() -> pd.DataFrame:
    """Two uniform lines, at two H each, of beta = 1 - h/H; markers of no such law; bounds 2 % apart."""
    rows: list[list[Any]] = []
    for label, H, ratio in product(("square", "L-shape"), (1 / 8, 1 / 16), (2.0, 1.0, 0.5, 0.25)):
        beta = max(1 - ratio, 0) * (1 if label == "square" else 0.9)
        rows.append(["a scene", label, "uniform", H, ratio, 1 / ratio, beta, 1.02 * beta])
    for label, ratio, edges in (("graded", 5.0, 2.0), ("graded", 3.0, 4.0), ("shifted", 0.5, 1.6)):
        rows.append(["graded", label, "local", 1 / 8, ratio, edges, 0.7, 0.714])
    rows.append(["worst", "nested", "worst", 1 / 8, 0.7, 2.5, 0.123, 0.12546])
    columns = ["scene", "label", "kind", "H", "h_over_H", "edges_per_cell", "beta_lower", "beta_upper"]
    return pd.DataFrame(rows, columns=columns)


def multiplier_table() -> pd.DataFrame:
    """Two cells a side; the values do not alternate."""
    cells = [(ratio, beta, i) for ratio, beta in ((1.0, 0.0), (0.8, 0.5494)) for i in range(8)]
    rows = [[ratio, beta, i // 2, i / 2, (i + 1) / 2, np.cos(i) * ratio] for ratio, beta, i in cells]
    return pd.DataFrame(rows, columns=["h_over_H", "beta", "side", "s", "end", "mu"])


def dual_norm_table() -> pd.DataFrame:
    """Mean, gap and shortcut that do not follow from the bounds: nothing is computed in the figure."""
    names = (("error", "natural"), ("error", "thirds"), ("error", "smooth"), ("one", ""), ("alternating", ""))
    rows = [
        [kind, case, H / 2, H, 0.5, i * H, 2 * i * H, 1.7 * i * H, 0.01 * i, 3 * i * H**0.5]
        for (i, (kind, case)), H in product(enumerate(names, start=1), (1 / 4, 1 / 8, 1 / 16))
    ]
    columns = ["kind", "case", "h", "H", "h_over_H", "lower", "upper", "mean", "gap", "shortcut"]
    return pd.DataFrame(rows, columns=columns)


TABLES: dict[str, Callable[[], pd.DataFrame]] = {
    "infsup": infsup_table,
    "multiplier": multiplier_table,
    "dual_norm": dual_norm_table,
}
CHANGED = {"infsup": "beta_lower", "multiplier": "mu", "dual_norm": "mean"}
COLUMNS = [(figure, column) for figure, table in TABLES.items() for column in table().columns]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for figure, table in TABLES.items():
        table().to_csv(tmp_path / f"{figure}.csv", index=False)
    return tmp_path


def draw(figure: str, folder: Path, target: str = "figure.svg") -> bytes:
    getattr(plots, figure)(folder / f"{figure}.csv", folder / target)
    return (folder / target).read_bytes()


def points(axes: Axes) -> set[tuple[float, float]]:
    """Of the lines and markers, without those in the axes' own coordinates."""
    lines = [line for line in axes.lines if line.get_transform() == axes.transData]
    return {tuple(point) for line in lines for point in np.asarray(line.get_xydata()).round(9).tolist()}


def pairs(table: pd.DataFrame, x: str, y: str) -> set[tuple[float, float]]:
    return {tuple(pair) for pair in table[[x, y]].round(9).to_numpy().tolist()}


@pytest.mark.parametrize("figure", TABLES)
def test_the_same_table_gives_the_same_bytes(figure: str, folder: Path) -> None:
    first = draw(figure, folder)
    assert draw(figure, folder, "again.svg") == first
    changed = TABLES[figure]()
    changed.loc[3, CHANGED[figure]] += 0.3
    changed.to_csv(folder / f"{figure}.csv", index=False)
    assert draw(figure, folder) != first


def test_another_process_gives_the_same_bytes(folder: Path) -> None:
    first = {figure: draw(figure, folder) for figure in TABLES}
    calls = "\n".join(f"plots.{figure}('{figure}.csv', '{figure}.svg')" for figure in TABLES)
    program = f"import sys\nfrom unilateral import plots\n{calls}"
    program += "\nassert 'matplotlib.pyplot' not in sys.modules"
    run_elsewhere(program, folder)
    assert {figure: (folder / f"{figure}.svg").read_bytes() for figure in TABLES} == first


@pytest.mark.parametrize("figure", TABLES)
def test_text_is_as_large_as_in_a_paper_and_on_the_page(
    figure: str, folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    svg = draw(figure, folder).decode()
    assert not re.search(r"\d{4}-\d\d-\d\d|dc:date|<text", svg)
    check_page(*drawn[0])


def test_beta_stands_over_both_ratios(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    """Lower bounds: on the left of the uniform scenes only, elsewhere of all; and none but the table's."""
    draw("infsup", folder)
    uniform, ratio, local = drawn[0][0].axes
    table = infsup_table().assign(inverse=lambda rows: 1 / rows["edges_per_cell"])
    of_uniform = table[table["kind"] == "uniform"]
    assert points(uniform) == pairs(of_uniform, "h_over_H", "beta_lower")
    assert points(ratio) == pairs(table, "h_over_H", "beta_lower")
    assert points(local) == pairs(table, "inverse", "beta_lower")
    assert points(ratio) != points(local)
    assert points(ratio) != pairs(table, "h_over_H", "beta_upper")


@pytest.mark.parametrize("beta", [0.0, 0.2])
def test_an_axis_is_cut_only_where_beta_is_zero_beyond(
    beta: float, folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    table = infsup_table()
    table.loc[(table["kind"] == "uniform") & (table["h_over_H"] == 2), ["beta_lower", "beta_upper"]] = beta
    table.to_csv(folder / "infsup.csv", index=False)
    draw("infsup", folder)
    uniform, _, local = drawn[0][0].axes
    cut = [axes.get_xlim()[1] < 2 for axes in (uniform, local)]
    said = [text.get_text() for text in texts(drawn[0][0])]
    assert cut == [beta == 0] * 2
    assert said.count("$0$ up\nto $2$") == (2 if beta == 0 else 0)


def test_the_note_gives_the_width_of_the_bounds_if_it_is_known(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw("infsup", folder)
    infsup_table().assign(widest=0.0123).to_csv(folder / "infsup.csv", index=False)
    draw("infsup", folder)
    without, with_width = ([text.get_text() for text in texts(page)] for page, _ in drawn)
    assert any("at most 1.2 % higher" in text for text in with_width)
    assert not any("%" in text for text in without)


def test_multipliers_and_their_beta_are_those_of_the_table(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw("multiplier", folder)
    page, table = drawn[0][0], multiplier_table()
    said = [text.get_text() for text in texts(page)]
    assert [text for text in said if "beta" in text] == [
        "$h/H=4/5$\n$\\beta=0.549$",
        "$h/H=1$\n$\\beta=0$",
    ]
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


def test_norms_gaps_and_shortcuts_are_those_of_the_table(
    folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    """The shortcut stands beside the norm of both functions and of the first two cases."""
    draw("dual_norm", folder)
    errors, gaps, norms = drawn[0][0].axes
    table = dual_norm_table()
    assert points(errors) == pairs(table[table["kind"] == "error"], "H", "mean")
    assert points(gaps) == pairs(table, "H", "gap")
    compared = table[table["case"] != "smooth"]
    assert points(norms) == pairs(compared, "H", "mean") | pairs(compared, "H", "shortcut")
    assert points(gaps) != pairs(table.assign(gap=table["upper"] / table["lower"] - 1), "H", "gap")


@pytest.mark.parametrize(("figure", "column"), COLUMNS)
def test_a_missing_column_is_named_and_nothing_is_written(figure: str, column: str, folder: Path) -> None:
    TABLES[figure]().drop(columns=column).to_csv(folder / f"{figure}.csv", index=False)
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match=rf"{figure}\.csv: the column '{column}' is missing"):
        draw(figure, folder)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("figure", "column", "value", "message"),
    [
        ("infsup", "kind", "wurst", "column 'kind': it has to hold all of uniform, local, worst"),
        ("infsup", "beta_lower", "high", "column 'beta_lower': all entries have to be numbers"),
        ("multiplier", "side", 4, "column 'side': the sides have to be numbered from 0 to 3"),
        ("dual_norm", "kind", "errors", "column 'kind': it has to hold all of error, one, alternating"),
    ],
)
def test_a_bad_entry_is_refused(figure: str, column: str, value: object, message: str, folder: Path) -> None:
    table = TABLES[figure]().astype({column: object})
    table.loc[1, column] = value
    table.to_csv(folder / f"{figure}.csv", index=False)
    with pytest.raises(InputError, match=rf"{figure}\.csv, {message}"):
        draw(figure, folder)
    assert not (folder / "figure.svg").exists()
