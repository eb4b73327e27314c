"""The figure of where it breaks: its points, their marks, and only those."""

import numpy as np
import pandas as pd

from examples import drawn_from, extremes_table
from unilateral.study.figures.extremes import KINDS


def test_every_point_stands_at_its_value_with_its_mark(tmp_path, drawn):
    drawn_from("extremes", tmp_path)
    strips = drawn[0][0].axes
    assert [strip.get_title(loc="left") for strip in strips] == ["size", "rho"]
    for strip, (_, of) in zip(strips, extremes_table().groupby("label", sort=False), strict=True):
        found = {
            (round(float(x), 9), line.get_marker())
            for line in strip.lines
            for x in np.atleast_1d(line.get_xdata())
            if line.get_marker() != "None"
        }
        assert found == {
            (round(x, 9), KINDS[kind][0]) for x, kind in zip(of["log10_value"], of["kind"], strict=True)
        }


def test_mild_is_left_and_limits_are_where_they_are_predicted(tmp_path, drawn):
    drawn_from("extremes", tmp_path)
    size, rho = drawn[0][0].axes
    assert size.xaxis_inverted()
    assert not rho.xaxis_inverted()
    upright = [{float(x) for x in line.get_xdata()} for line in size.lines if line.get_marker() == "None"]
    assert {-2.0} in upright
    assert {-4.0} in upright
    assert len([line for line in rho.lines if line.get_marker() == "None"]) == 1


def test_near_points_are_drawn_apart(tmp_path, drawn):
    drawn_from("extremes", tmp_path)
    rho = drawn[0][0].axes[1]
    points = next(
        line.get_xydata() for line in rho.lines if line.get_marker() == "o" and len(line.get_xdata())
    )
    heights = dict(np.round(np.asarray(points), 6).tolist())
    assert heights[-0.0004] * heights[0.0004] < 0
    assert heights[-0.3] == heights[0.3] == 0


def test_what_broke_is_below_what_is_right_near_it(tmp_path, drawn):
    """Three points near a limit, the first of which is right; and ticks are round powers of 10."""
    start = ["start", "right", 0.0, 299.7, np.nan]
    near = [["start", kind, x, 299.7, np.nan] for kind, x in (("right", 299.6), *2 * [("refused", 299.8)])]
    table = pd.DataFrame([start, *near], columns=list(extremes_table()))
    drawn_from("extremes", tmp_path, extremes=table)
    strip = drawn[0][0].axes[0]
    heights = {
        (line.get_marker(), round(float(x), 1)): y
        for line in strip.lines
        if line.get_marker() in ("o", "s")
        for x, y in np.asarray(line.get_xydata()).tolist()
    }
    assert heights == {("o", 0.0): 0.0, ("o", 299.6): 0.5, ("s", 299.8): -0.5}
    assert strip.get_xticks().tolist() == [0, 50, 100, 150, 200, 250]
