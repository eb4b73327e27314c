"""The figure of the consistency term: its table, and its numbers, and only those."""

from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import load, texts
from matplotlib.colors import to_hex
from matplotlib.patches import StepPatch

from examples import TERMS, consistency_table, drawn_from
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import named
from unilateral.norms.exact import cell_means
from unilateral.study import tables
from unilateral.study.figures import consistency
from unilateral.study.runs.consistency import first_transition, leading


def of_data(axes, markers):
    """The lines of the axes' data, point by point, with or without markers."""
    drawn = [line for line in axes.lines if line.get_transform() == axes.transData]
    with_them = [line for line in drawn if (line.get_marker() not in ("None", "")) == markers]
    return [list(map(tuple, np.asarray(line.get_xydata()).tolist())) for line in with_them]


def test_both_means_stand_on_their_cells(tmp_path, drawn):
    drawn_from("consistency", tmp_path)
    steps = [patch.get_data() for patch in drawn[0][0].axes[0].patches if isinstance(patch, StepPatch)]
    assert all(step.edges.tolist() == [0, 0.25, 0.5, 0.75, 1] for step in steps)
    assert {tuple(step.values) for step in steps} == {
        tuple(means) for means in (TERMS["lambda_mean"], TERMS["gap_mean"])
    }


def test_every_cell_s_term_is_marked_and_zeros_stand_at_the_foot(tmp_path, drawn):
    drawn_from("consistency", tmp_path)
    axes = drawn[0][0].axes[1]
    positive, zero = of_data(axes, markers=True)
    assert positive == [(0.375, 3e-5), (0.875, 2e-8)]
    foot = axes.get_ylim()[0]
    assert zero == [(0.125, foot), (0.625, foot)]
    assert foot < 2e-8
    assert axes.get_yticklabels()[0].get_text() == "$0$"
    grey = sorted(patch.get_bbox().x0 for patch in axes.patches)
    assert grey == [0.25, 0.75]


def test_totals_are_marked_and_what_is_predicted_is_a_line_per_theta(tmp_path, drawn):
    drawn_from("consistency", tmp_path)
    axes = drawn[0][0].axes[2]
    for kind, markers in (("total", True), ("predicted", False)):
        rows = consistency_table().query(f"kind == '{kind}'").sort_values("H")
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
def test_what_other_cells_add_is_said(elsewhere, said, tmp_path, drawn):
    changed = consistency_table().reset_index(drop=True)
    changed.loc[changed.index[changed["kind"] == "elsewhere"][2], "term"] = elsewhere
    drawn_from("consistency", tmp_path, consistency=changed)
    assert any(said in text.get_text() for text in texts(drawn[0][0]))


def test_cases_are_named_with_their_powers(tmp_path, drawn):
    drawn_from("consistency", tmp_path)
    names = [text.get_text() for text in drawn[0][0].legends[0].get_texts()]
    assert names == ["flat: $H^{2}$", "steep: $H^{3}$"]


def errors():
    """Totals and parts of no law."""
    return xr.Dataset(
        {
            "consistency": (("case", "partition"), [[0.5, 0.25]]),
            "consistency_elsewhere": (("case", "partition"), [[0.125, 0.0625]]),
        },
        coords={"case": ["thirds"], "H": ("partition", [1 / 4, 1 / 8])},
    )


def test_the_table(tmp_path):
    scene = {"polygon": "square", "side": 0, "cases": ["natural", "thirds"]}
    tables.save(errors(), tmp_path / "errors.nc", "scene")
    frame = consistency.table([tmp_path / "errors.nc"], [scene], "thirds", "1/16", ["thirds"])
    case, cells = load("thirds"), uniform(named("square"), 1 / 16)
    kinds = {kind: rows for kind, rows in frame.groupby("kind")}
    assert set(kinds) == {"cell", "total", "elsewhere", "predicted"}
    found, of_cells = cell_means(case, cells), kinds["cell"]
    assert len(of_cells) == 16
    np.testing.assert_array_equal(of_cells["term"], found.consistency_terms[:16])
    np.testing.assert_allclose(of_cells["lambda_mean"] * of_cells["gap_mean"] / 16, of_cells["term"])
    np.testing.assert_array_equal(of_cells["end"][:-1], of_cells["s"][1:])
    assert kinds["total"]["term"].tolist() == [0.5, 0.25]
    assert kinds["total"]["over_H2"].tolist() == [8.0, 16.0]
    assert kinds["elsewhere"]["term"].tolist() == [0.125, 0.0625]
    expected = [leading(first_transition(case), uniform(named("square"), H))[0] for H in (1 / 4, 1 / 8)]
    assert kinds["predicted"]["term"].tolist() == expected
    thetas = [Fraction(theta).limit_denominator(9) for theta in kinds["total"]["theta"]]
    assert thetas == [Fraction(1, 3), Fraction(2, 3)]
    assert (pd.concat([kinds["total"], kinds["predicted"]])["rate"] == 3).all()
