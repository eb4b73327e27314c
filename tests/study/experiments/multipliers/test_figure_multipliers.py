"""The figure of other methods' multipliers: its table, and its lines, and only those."""

import numpy as np
import pytest
import xarray as xr
from pages import lines, list_texts, page, table

from study import tables
from study.experiments.multipliers import multipliers_figure

H = np.array([1 / 4, 1 / 8])


def test_a_panel_has_the_lines_of_its_case_and_norm_and_no_others():
    """Points are those of the table; a line for each method, and that of the order."""
    data = table("multipliers")
    panels = page("multipliers")[0].axes
    keys = list(dict.fromkeys(zip(data["case"], data["norm"], strict=True)))
    assert len(panels) == len(keys) == 6
    for axes in panels:
        computed = sorted(lines(axes))
        matching = [
            key
            for key in keys
            if computed
            == sorted(
                rows[["h", "error"]].round(9).apply(tuple, axis=1).tolist()
                for _, rows in data[(data["case"] == key[0]) & (data["norm"] == key[1])].groupby("scheme")
            )
        ]
        assert len(matching) == 1
        keys.remove(matching[0])


def test_the_key_names_every_method_once():
    texts = list_texts(page("multipliers")[0])
    schemes = set(table("multipliers")["scheme"]) - {"order"}
    assert all(texts.count(scheme) == 1 for scheme in schemes)
    assert len(schemes) == 6


def test_a_linear_function_has_the_colour_of_its_multiplier_and_open_markers():
    figure = page("multipliers")[0]
    (legend,) = figure.legends
    handles = {
        text.get_text(): line for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }
    for name in ("P0, H = 2h", "nodal reactions"):
        multiplier = handles[name]
        linear = handles[f"{name}, linear"]
        assert linear.get_color() == multiplier.get_color() == multiplier.get_markerfacecolor()
        assert linear.get_marker() == multiplier.get_marker()
        assert linear.get_markerfacecolor() == "white"
    colours = [line.get_color() for name, line in handles.items() if not name.endswith("linear")]
    assert len(set(colours)) == len(colours)


def test_the_table_has_the_errors_and_lines_of_the_orders(tmp_path):
    """In H^{-1/2} the r.m.s. mean of the bounds 1 and 7 is 5. The line begins at 3/2 of the largest."""
    dims = ("case", "scheme", "mesh")
    lower = np.array([[[1, 0.5], [2, 1]]])
    values = {"hm12_error_lower": lower, "hm12_error_upper": 7 * lower, "l2_error": 3 * lower}
    stored = xr.Dataset(
        {name: (dims, value) for name, value in values.items()},
        coords={"case": ["natural"], "scheme": ["a", "b"], "h": ("mesh", H)},
    )
    tables.save_table(stored, tmp_path / "errors.nc", "multipliers")
    rows = multipliers_figure.table(tmp_path / "errors.nc")
    assert set(rows["case"]) == {"natural"}
    expected = {
        ("hm12", "a"): [5, 2.5],
        ("hm12", "b"): [10, 5],
        ("hm12", "order"): [15, 15 / 2**1.5],
        ("l2", "a"): [3, 1.5],
        ("l2", "b"): [6, 3],
        ("l2", "order"): [9, 4.5],
    }
    for (norm, scheme), errors in expected.items():
        line = rows[(rows["norm"] == norm) & (rows["scheme"] == scheme)]
        assert line["h"].tolist() == H.tolist()
        assert line["error"].tolist() == pytest.approx(errors)
    assert len(rows) == 12
