"""The figure of the consistency term: its table, and its numbers, and only those."""

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import load
from matplotlib.colors import to_hex
from matplotlib.patches import StepPatch
from pages import draw_page, lines, list_texts, page, table

from study import tables
from study.experiments.estimates import consistency_figure as consistency
from study.experiments.estimates.consistency_figure import first_transition, leading_term
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import find_polygon
from unilateral.norms.exact_errors import cell_means


def cells():
    return table("consistency").query("kind == 'cell'")


def test_both_means_stand_on_their_cells():
    steps = [p.get_data() for p in page("consistency")[0].axes[0].patches if isinstance(p, StepPatch)]
    assert all(step.edges.tolist() == [*cells()["s"], 1] for step in steps)
    expected = {tuple(cells()[name]) for name in ("lambda_mean", "gap_mean")}
    assert {tuple(step.values) for step in steps} == expected


def test_every_cell_s_term_is_marked_and_zeros_stand_at_the_foot():
    axes = page("consistency")[0].axes[1]
    rows = cells().assign(x=lambda table: 0.5 * (table["s"] + table["end"]))
    foot = axes.get_ylim()[0]
    some = rows["term"] > 0
    positive, zero = lines(axes, markers=True)
    assert positive == list(zip(rows["x"][some].round(9), rows["term"][some].round(9), strict=True))
    assert zero == [(round(x, 9), round(foot, 9)) for x in rows["x"][~some]]
    assert foot < rows["term"][some].min()
    assert axes.get_yticklabels()[0].get_text() == "$0$"
    assert sorted(patch.get_bbox().x0 for patch in axes.patches) == rows["s"][some].tolist()


def test_totals_are_marked_and_what_is_predicted_is_a_line_per_theta():
    """Marks are filled for the first theta; cases are named with their powers."""
    figure = page("consistency")[0]
    rows = table("consistency")
    axes = figure.axes[2]
    for kind, markers in (("total", True), ("predicted", False)):
        groups = rows[rows["kind"] == kind].sort_values("H").groupby(["case", "theta"])
        expected = [
            list(zip(component["H"], component["over_H2"].round(9), strict=True)) for _, component in groups
        ]
        assert sorted(lines(axes, markers)) == sorted(expected)
    theta = rows.dropna(subset="theta").groupby("H")["theta"].first()
    for line in (line for line in axes.lines if line.get_marker() not in ("None", "")):
        filled = to_hex(line.get_markerfacecolor()) == to_hex(line.get_color())
        assert {theta[x] == theta.min() for x in line.get_xdata()} <= {filled}
    rate = rows.dropna(subset="rate").groupby("case")["rate"].first().sort_values(kind="stable")
    named_so = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sorted(named_so) == sorted(f"{case}: $H^{{{power:g}}}$" for case, power in rate.items())
    assert [float(text.split("{")[1][:-2]) for text in named_so] == rate.tolist()


@pytest.mark.parametrize(("elsewhere", "text"), [(0.0, "the term is 0,"), (3e-7, "the term is 3e-07,")])
def test_what_other_cells_add_is_said(elsewhere, text):
    changed = table("consistency")
    changed.loc[changed.index[changed["kind"] == "elsewhere"], "term"] = 0.0
    changed.loc[changed.index[changed["kind"] == "elsewhere"][2], "term"] = elsewhere
    assert any(text in item for item in list_texts(draw_page("consistency", changed)[0]))


def test_the_table_has_cells_totals_the_remainder_and_predictions(tmp_path):
    """Totals and parts of no law."""
    run = ("case", "partition")
    terms = {"consistency": (run, [[0.5, 0.25]]), "consistency_elsewhere": (run, [[0.125, 0.0625]])}
    made_up = xr.Dataset(terms, coords={"case": ["thirds"], "H": ("partition", [1 / 4, 1 / 8])})
    tables.save_table(made_up, tmp_path / "errors.nc", "scene")
    scene = {"polygon": "square", "side": 0, "cases": ["natural", "thirds"]}
    frame = consistency.table([tmp_path / "errors.nc"], [scene], "thirds", "1/16", ["thirds"])
    case = load("thirds")
    kinds = {kind: rows for kind, rows in frame.groupby("kind")}
    assert set(kinds) == {"cell", "total", "elsewhere", "predicted"}
    computed = cell_means(case, make_uniform_partition(find_polygon("square"), 1 / 16))
    cells = kinds["cell"]
    assert len(cells) == 16
    np.testing.assert_array_equal(cells["term"], computed.consistency_terms[:16])
    np.testing.assert_allclose(cells["lambda_mean"] * cells["gap_mean"] / 16, cells["term"])
    np.testing.assert_array_equal(cells["end"][:-1], cells["s"][1:])
    assert kinds["total"]["term"].tolist() == [0.5, 0.25]
    assert kinds["total"]["over_H2"].tolist() == [8.0, 16.0]
    assert kinds["elsewhere"]["term"].tolist() == [0.125, 0.0625]
    expected = [
        leading_term(first_transition(case), make_uniform_partition(find_polygon("square"), H))[0]
        for H in (1 / 4, 1 / 8)
    ]
    assert kinds["predicted"]["term"].tolist() == expected
    thetas = [Fraction(theta).limit_denominator(9) for theta in kinds["total"]["theta"]]
    assert thetas == [Fraction(1, 3), Fraction(2, 3)]
    assert (pd.concat([kinds["total"], kinds["predicted"]])["rate"] == 3).all()
