"""The maps over (h, H): their table from a made-up study, and their numbers."""

import re

import numpy as np
from pages import list_texts, page, study_errors, table

from study import tables
from study.experiments.scenes import grid_figure as grid


def test_the_table_has_an_error_per_pair_and_norm_where_one_was_solved(tmp_path):
    tables.save_table(study_errors(), tmp_path / "errors.nc", "scene")
    frame = grid.table(tmp_path / "errors.nc", ["made_up"])
    assert len(frame) == 3 * 3 * 4
    np.testing.assert_allclose(frame["h_over_H"], frame["h"] / frame["H"], rtol=1e-15)
    assert frame["beta_zero"].tolist() == (frame["h"] == frame["H"]).astype(int).tolist()
    solved = (frame["H"] == 2 * frame["h"]) | ((frame["norm"] == "h1") & (frame["H"] == frame["h"]))
    assert frame["error"].notna().tolist() == solved.tolist()
    kept_frame = frame[solved]
    np.testing.assert_allclose(kept_frame["error"], 10 * kept_frame["h"] + kept_frame["H"], rtol=1e-15)


def test_every_error_stands_in_its_cell():
    rows = table("grid")
    texts = list_texts(page("grid")[0])
    numbers = [float(text) for text in texts if re.fullmatch(r"\d\.\de-\d", text)]
    assert sorted(numbers) == sorted(float(f"{error:.1e}") for error in rows["error"].dropna())
    assert texts.count("$\\beta=0$") == np.sum(rows["error"].isna() & (rows["beta_zero"] == 1)) > 0


def test_no_line_runs_through_a_number():
    """Neither the dashes of constant h/H nor what underlines an error; dashes three times as long would."""
    figure = page("grid")[0]
    figure.draw_without_rendering()
    numbers = [text.get_window_extent() for axes in figure.axes for text in axes.texts if cell(text)]
    dashes = [
        line.get_transform().transform(line.get_xydata()) for axes in figure.axes for line in axes.lines
    ]
    assert len(numbers) > 100
    assert not any(meets(dash, box) for dash in dashes for box in numbers)
    longer = [dash.mean(axis=0) + 3 * (dash - dash.mean(axis=0)) for dash in dashes]
    assert any(meets(dash, box) for dash in longer for box in numbers)


def cell(text):
    return re.fullmatch(r"\d\.\de-\d", text.get_text()) or "beta" in text.get_text()


def meets(dash, box):
    """Whether one of 50 points of a line lies in the box of a text, drawn in by what it has of blank."""
    points = np.linspace(*dash, 50)
    return bool(np.all((points > (box.x0, box.y0 + 2)) & (points < (box.x1, box.y1 - 2)), axis=1).any())
