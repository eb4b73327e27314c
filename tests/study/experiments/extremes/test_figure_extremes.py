"""The figure of where it breaks: its points, their marks, and only those."""

import numpy as np
import pandas as pd
from pages import draw_page, page, table

from study.experiments.extremes.extremes_figure import OUTCOME_MARKS


def marks(axes):
    """The points with their marks, and their heights."""
    lines = [line for line in axes.lines if line.get_marker() != "None"]
    return [(round(x, 9), line.get_marker(), y) for line in lines for x, y in line.get_xydata().tolist()]


def test_every_point_stands_at_its_value_with_its_mark():
    """Mild is left; limits are lines where they are predicted."""
    groups = table("extremes").groupby("label", sort=False)
    for strip, (label, rows) in zip(page("extremes")[0].axes, groups, strict=True):
        assert strip.get_title(loc="left") == label
        expected = {
            (round(x, 9), OUTCOME_MARKS[kind][0])
            for x, kind in zip(rows["log10_value"], rows["kind"], strict=True)
        }
        assert {(x, mark) for x, mark, _ in marks(strip)} == expected
        values = rows["log10_value"].to_numpy()
        assert strip.xaxis_inverted() == (values[-1] < values[0])
        upright = {float(line.get_xdata()[0]) for line in strip.lines if line.get_marker() == "None"} - {0.0}
        remaining, right = sorted(strip.get_xlim())
        limits = {float(rows[name].iloc[0]) for name in ("log10_limit", "log10_tool_limit")}
        assert upright == {limit for limit in limits if remaining <= limit <= right} - {0.0}


def strip_of(*points):
    """The strip drawn of such an axis."""
    columns = ["label", "kind", "log10_value", "log10_limit", "log10_tool_limit"]
    rows = [["start", kind, x, 299.7, np.nan] for kind, x in points]
    return draw_page("extremes", pd.DataFrame(rows, columns=columns))[0].axes[0]


def test_near_points_are_drawn_apart():
    heights = {x: y for x, _, y in marks(strip_of(*(("right", x) for x in (-0.3, -0.0004, 0.0004, 0.3))))}
    assert heights[-0.0004] * heights[0.0004] < 0
    assert heights[-0.3] == heights[0.3] == 0


def test_what_broke_is_below_what_is_right_near_it():
    """Three points near a limit, the first of which is right; and ticks are round powers of 10."""
    strip = strip_of(("right", 0.0), ("right", 299.6), *2 * [("refused", 299.8)])
    assert set(marks(strip)) == {(0.0, "o", 0.0), (299.6, "o", 0.5), (299.8, "s", -0.5)}
    assert strip.get_xticks().tolist() == [0, 50, 100, 150, 200, 250]
