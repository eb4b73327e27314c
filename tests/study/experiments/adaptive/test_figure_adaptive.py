"""The figure of adapted meshes: its table from a made-up study, and its numbers, and only those."""

import numpy as np
import pandas as pd
import xarray as xr
from pages import draw_page, list_texts, page, pairs, points, table

from study import tables
from study.experiments.adaptive import adaptive_figure as adaptive


def test_the_table_has_a_row_per_level_and_whole_numbers_of_unknowns(tmp_path):
    """A row per level that there is; unknowns are whole numbers, which a CSV table does not round."""
    order = ("case", "kind", "level")
    N = np.array([[[12345.0, np.nan], [12345.0, 23456.0]]])
    errors = {"unknowns": (order, N), "h1_error": (order, 1 / N), "h1_bound": (order, 2 / N)}
    constants = {"beta_lower": (order, 3 / N), "beta_of_edges": (order, 4 / N)}
    coords = {"case": ["c"], "kind": ["uniform", "adapted"], "level": [0, 1]}
    for name, values in (("errors", errors), ("infsup", constants)):
        tables.save_table(xr.Dataset(values, coords), tmp_path / f"{name}.nc", "adaptive")
    table = adaptive.table(tmp_path / "errors.nc", tmp_path / "infsup.nc")
    assert table["kind"].tolist() == ["uniform", "adapted", "adapted"]
    assert table["unknowns"].tolist() == [12345, 12345, 23456]
    assert table["unknowns"].dtype.kind == "i"
    columns = table[["error", "bound", "beta", "beta_of_edges"]] * table["unknowns"].to_numpy()[:, None]
    np.testing.assert_allclose(columns, np.broadcast_to([1, 2, 3, 4], (3, 4)), rtol=1e-12)


def test_every_error_and_bound_stands_over_its_unknowns():
    """In the panel of its case; a problem without a known solution has bounds only."""
    rows = table("adaptive")
    panels = page("adaptive")[0].axes
    cases = list(dict.fromkeys(rows["case"]))
    assert [axes.get_title() for axes in panels[:-1]] == cases
    for case, axes in zip(cases, panels[:-1], strict=True):
        case_rows = rows[rows["case"] == case]
        drawn_there = {(x, y) for x, y in points(axes) if np.isfinite(y)}
        assert drawn_there == pairs(case_rows, "unknowns", "error") | pairs(case_rows, "unknowns", "bound")


def test_beta_stands_over_the_unknowns_of_adapted_meshes():
    rows = table("adaptive")
    axes = page("adaptive")[0].axes[-1]
    assert points(axes) == pairs(rows, "unknowns", "beta") | pairs(rows, "unknowns", "beta_of_edges")
    assert set(rows["case"]) <= set(list_texts(page("adaptive")[0]))


def test_another_number_of_cases_has_its_panels():
    rows = table("adaptive")
    extra = rows[rows["case"] == "thirds"].assign(case="sixths")
    figure, _ = draw_page("adaptive", pd.concat([rows, extra]))
    assert len(figure.axes) == rows["case"].nunique() + 2
    assert figure.get_figheight() > page("adaptive")[0].get_figheight()
