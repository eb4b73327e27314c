"""The figures: the same bytes from the same table, all of the table and nothing else, never half a file."""

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
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from unilateral.errors import InputError, StorageError
from unilateral.study import figures as plots

NORMS = ("h1", "hm12", "l2")
PROVED = {"h1": 1.0, "hm12": 1.0, "l2": 0.5}


def rates_table() -> pd.DataFrame:
    """Two cases on three levels at two ratios; no_contact's multiplier is exact. The rates fit no error."""
    rows = [
        {
            "scene": "square",
            "case": case,
            "norm": norm,
            "h_over_H": ratio,
            "h": h,
            "H": h / ratio,
            "error": 0.0 if case == "no_contact" and norm != "h1" else h**1.2,
            "asymptotic": int(h < 0.1),
            "rate": np.nan if case == "no_contact" and norm != "h1" else 7.77,
            "proved": PROVED[norm],
            "expected": 3.33,
        }
        for case, norm, ratio, h in product(
            ("natural", "no_contact"), NORMS, (0.5, 0.25), (1 / 8, 1 / 16, 1 / 32)
        )
    ]
    return pd.DataFrame(rows)


def grid_table() -> pd.DataFrame:
    """beta = 0 from h = H on, where only u_h has an error; h = 1/8 with H = 1/32 is not computed."""
    rows = []
    for case, norm, h, H in product(
        ("natural", "smooth"), NORMS, (1 / 8, 1 / 16), (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    ):
        zero = h / H in (1, 2)
        known = h / H <= 2 and (norm == "h1" or not zero)
        error = 0.0123 * h + H**2 if known else np.nan
        rows.append([case, norm, h, H, h / H, error, int(zero)])
    return pd.DataFrame(rows, columns=["case", "norm", "h", "H", "h_over_H", "error", "beta_zero"])


def mesh_table() -> pd.DataFrame:
    """The unit square in two triangles."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], dtype=float)
    return pd.DataFrame(
        {
            "h": 1.0,
            "H": 2.0,
            "triangle": np.repeat([0, 1], 3),
            "x": corners[:, 0],
            "y": corners[:, 1],
            "u_h": corners @ [1.0, 2.0],
        }
    )


def boundary_table() -> pd.DataFrame:
    """Contact on the second half of side 0 and on side 1, one cell per half side."""
    columns = ["kind", "side", "s", "end", "computed", "exact", "contact", "x", "y"]
    vertices = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
    rows: list[list[Any]] = []
    for side, t in product(range(4), (0.0, 0.5, 1.0)):
        s, (x, y) = side + t, vertices[side] + t * (vertices[side + 1] - vertices[side])
        touching = 0.5 <= s <= 2
        rows.append(["trace", side, s, None, 0.01 * s, 0.0 if touching else 0.1, int(touching), x, y])
        rows.append(["flux", side, s, None, None, float(touching), None, None, None])
        if t < 1:
            rows.append(["multiplier", side, s, s + 0.5, 0.9 * touching, None, None, None, None])
    return pd.DataFrame(rows, columns=columns)


TABLES: dict[str, dict[str, Callable[[], pd.DataFrame]]] = {
    "rates": {"rates.csv": rates_table},
    "grid": {"grid.csv": grid_table},
    "portrait": {"mesh.csv": mesh_table, "boundary.csv": boundary_table},
}
COLUMNS = [
    (figure, name, column)
    for figure, tables in TABLES.items()
    for name, table in tables.items()
    for column in table().columns
]


def write(folder: Path) -> None:
    for tables in TABLES.values():
        for name, table in tables.items():
            table().to_csv(folder / name, index=False)


def draw(figure: str, folder: Path, target: str = "figure.svg") -> bytes:
    getattr(plots, figure)(*(folder / name for name in TABLES[figure]), folder / target)
    return (folder / target).read_bytes()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path)
    return tmp_path


@pytest.mark.parametrize("figure", TABLES)
def test_the_same_table_gives_the_same_bytes(figure: str, folder: Path) -> None:
    first = draw(figure, folder)
    assert draw(figure, folder, "again.svg") == first
    name = next(iter(TABLES[figure]))
    column = {"rates": "error", "grid": "error", "portrait": "u_h"}[figure]
    changed = pd.read_csv(folder / name)
    changed.loc[1, column] *= 1.5
    changed.to_csv(folder / name, index=False)
    assert draw(figure, folder) != first


def test_another_process_gives_the_same_bytes(folder: Path) -> None:
    for figure in TABLES:
        draw(figure, folder, f"{figure}.svg")
    calls = "\n".join(f"plots.{f}({', '.join(map(repr, names))}, '{f}_2.svg')" for f, names in TABLES.items())
    program = (
        f"import sys\nfrom unilateral import plots\n{calls}\nassert 'matplotlib.pyplot' not in sys.modules"
    )
    run_elsewhere(program, folder)
    for figure in TABLES:
        assert (folder / f"{figure}_2.svg").read_bytes() == (folder / f"{figure}.svg").read_bytes()


@pytest.mark.parametrize("figure", TABLES)
def test_a_figure_depends_on_no_setting_of_the_user(figure: str, folder: Path) -> None:
    from matplotlib import rc_context

    first = draw(figure, folder)
    with rc_context(
        {"lines.linewidth": 9, "axes.facecolor": "red", "svg.hashsalt": None, "savefig.bbox": "tight"}
    ):
        assert draw(figure, folder, "again.svg") == first


@pytest.mark.parametrize("figure", TABLES)
def test_figures_carry_no_date_and_text_as_paths(figure: str, folder: Path) -> None:
    svg = draw(figure, folder).decode()
    assert svg.startswith("<?xml")
    assert not re.search(r"\d{4}-\d\d-\d\d|dc:date", svg)
    assert "<text" not in svg


@pytest.mark.parametrize("figure", TABLES)
def test_text_is_as_large_as_in_a_paper_and_on_the_page(
    figure: str, folder: Path, drawn: list[tuple[Figure, Bbox]]
) -> None:
    draw(figure, folder)
    check_page(*drawn[0])


def test_rates_are_those_of_the_table(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    """The table's rate, 7.77, is not the slope of its errors, 1.2: nothing is fitted here."""
    draw("rates", folder)
    said = [text.get_text() for text in texts(drawn[0][0])]
    assert said.count("7.77") == 2 * (3 + 1)  # two ratios; natural in three norms, no_contact in one
    assert said.count("–") == 2 * 2
    assert said.count("3.33") == 2 * 3
    assert said.count("no_contact: $\\lambda_H=0$ exactly") == 2
    assert not any("natural: " in text for text in said)


def test_every_error_stands_in_its_cell(folder: Path, drawn: list[tuple[Figure, Bbox]]) -> None:
    draw("grid", folder)
    said = [text.get_text() for text in texts(drawn[0][0])]
    errors = grid_table()["error"].dropna()
    numbers = [float(text) for text in said if re.fullmatch(r"\d\.\de-\d", text)]
    assert sorted(numbers) == sorted(float(f"{error:.1e}") for error in errors)
    unjudged = 2 * 2 * sum(h / H in (1, 2) for h, H in product((1 / 8, 1 / 16), (1 / 8, 1 / 16, 1 / 32)))
    assert said.count("$\\beta=0$") == unjudged  # two cases, the two norms of lambda


@pytest.mark.parametrize(("figure", "name", "column"), COLUMNS)
def test_a_missing_column_is_named_and_nothing_is_written(
    figure: str, name: str, column: str, folder: Path
) -> None:
    pd.read_csv(folder / name).drop(columns=column).to_csv(folder / name, index=False)
    before = sorted(folder.iterdir())
    with pytest.raises(InputError, match=rf"{re.escape(name)}: the column '{column}' is missing"):
        draw(figure, folder)
    assert sorted(folder.iterdir()) == before


@pytest.mark.parametrize(
    ("figure", "name", "content", "message"),
    [
        ("rates", "rates.csv", None, "there is no table"),
        ("rates", "rates.csv", "", "is no CSV table"),
        ("grid", "grid.csv", "case,norm\n", "no rows"),
        (
            "portrait",
            "mesh.csv",
            "triangle,x,y,u_h,h,H\n0,0,0,1,1,2\n0,1,0,high,1,2\n0,0,1,1,1,2\n",
            "column 'u_h': all entries",
        ),
        (
            "portrait",
            "mesh.csv",
            "triangle,x,y,u_h,h,H\n0,0,0,1,1,2\n0,1,0,1,1,2\n",
            "column 'triangle': every triangle",
        ),
    ],
)
def test_a_bad_table_is_refused(
    figure: str, name: str, content: str | None, message: str, folder: Path
) -> None:
    (folder / name).unlink() if content is None else (folder / name).write_text(content)
    with pytest.raises(InputError, match=message) as raised:
        draw(figure, folder)
    assert name in str(raised.value)
    assert not (folder / "figure.svg").exists()


@pytest.mark.parametrize(("figure", "name"), [("rates", "rates.csv"), ("grid", "grid.csv")])
def test_a_table_without_one_of_the_norms_is_refused(figure: str, name: str, folder: Path) -> None:
    table = pd.read_csv(folder / name)
    table[table["norm"] != "l2"].to_csv(folder / name, index=False)
    with pytest.raises(InputError, match=rf"{re.escape(name)}, column 'norm'.*l2"):
        draw(figure, folder)


@pytest.mark.parametrize("figure", TABLES)
def test_a_failure_while_writing_leaves_the_old_figure(
    figure: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "figure.svg").write_text("old")
    before = sorted(folder.iterdir())

    def breaking(_: Figure, path: Path, **options: Any) -> None:
        Path(path).write_text("<svg half")
        raise OSError("no space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Figure, "savefig", breaking)
        with pytest.raises(StorageError, match="no space"):
            draw(figure, folder)
    assert (folder / "figure.svg").read_text() == "old"
    assert sorted(folder.iterdir()) == before
    assert draw(figure, folder) != b"old"
