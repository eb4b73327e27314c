"""Where it breaks: an axis per row, each point with its mark, predicted limits as ticks."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study import style, tables
from study.experiments.extremes.numbers import RESCUED, outcome_kinds
from unilateral.arrays import Array, Mask

OUTCOME_MARKS = {
    "right": ("o", style.COLOURS[2]),
    RESCUED: ("o", "white"),
    "not converged": ("v", style.COLOURS[1]),
    "refused": ("s", style.COLOURS[0]),
    "wrong": ("X", "red"),
}
LIMIT_TICKS = {
    "log10_limit": (style.COLOURS[2], (0, 1), "predicted limit of plain Uzawa"),
    "log10_tool_limit": ("black", (-1, 0), "predicted limit of unilateral solve"),
}
STRIP_STEP_CM = 1.32
PANEL_HEIGHT_CM = 0.44
TOP_MARGIN_CM = 0.1
PANEL_BOTTOM_CM = 1.6
PANEL_LEFTS_CM = (0.35, 8.85)
PANEL_WIDTH_CM = 7.8
AXIS_MARGIN_SHARE = 0.07
MAX_TICK_STEPS = 6
TICK_STEPS = (1, 2, 3, 5, 10, 20, 50, 100)
"""The distances that ticks may have, in powers of 10."""
WHOLE_POWER_TOLERANCE = 1e-6
CROWDED_SHARE = 0.03
MIN_TICK_SHARE = 0.06
"""Two shares of an axis: points nearer than the first are drawn one above the other, and ticks on a short
axis are farther apart than the second."""
BROKEN_KINDS = tuple(kind for kind in OUTCOME_MARKS if not kind.startswith("right"))


def table(extremes: style.FilePath) -> pd.DataFrame:
    """A row per point: the axis's label, the kind of outcome, logarithms of the value and the limits."""
    points = tables.load_table(extremes)
    axes = points.sel(axis=points["axis_of"])
    limits = {f"log10_{name}": axes[f"predicted_{name}"] for name in ("limit", "tool_limit")}
    logarithms = {
        name: np.log10(limit.where(np.isfinite(limit)).values)
        for name, limit in {"log10_value": points["value"], **limits}.items()
    }
    return pd.DataFrame({"label": axes["label"].values, "kind": outcome_kinds(points), **logarithms})


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Two columns of strips, each an axis on a logarithmic scale from mild, at the left, to extreme.

    Columns: label (the axis), kind (of outcome), log10_value, and log10_limit and log10_tool_limit (as
    predicted, or empty).
    """
    groups = list(style.read_figure_table(csv_path).groupby("label", sort=False))
    rows = -(-len(groups) // 2)
    with style.open_figure(svg_path, TOP_MARGIN_CM + STRIP_STEP_CM * rows + PANEL_BOTTOM_CM) as figure:
        for k, (label, points) in enumerate(groups):
            column, row = divmod(k, rows)
            bottom = PANEL_BOTTOM_CM + STRIP_STEP_CM * (rows - 1 - row) + 0.45
            axes = style.add_axes(figure, PANEL_LEFTS_CM[column], bottom, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            _draw_strip(axes, points)
            axes.set_title(str(label), loc="left", fontsize=style.SMALL_FONT_POINTS, pad=2)
        _add_outcome_key(figure)


def _add_outcome_key(figure: Figure) -> None:
    """Add the key of outcomes and predicted limits at the foot."""
    handles = [
        style.legend_entry(kind, ls="", marker=mark, color=colour, mec=_edge_colour(colour))
        for kind, (mark, colour) in OUTCOME_MARKS.items()
    ]
    handles += [
        style.legend_entry(label, ls="", marker="|", ms=11, mew=1.6, color=colour)
        for colour, _, label in LIMIT_TICKS.values()
    ]
    corner = (0.01, 0.0)
    figure.legend(handles=handles, loc="lower left", ncols=3, bbox_to_anchor=corner, columnspacing=2.0)


def _edge_colour(colour: str) -> str:
    return OUTCOME_MARKS["right"][1] if colour == "white" else "white"


def _draw_strip(axes: Axes, points: pd.DataFrame) -> None:
    values = points["log10_value"].to_numpy()
    low = values.min()
    high = values.max()
    pad = AXIS_MARGIN_SHARE * (high - low)
    axes.set_xlim(low - pad, high + pad)
    if values[-1] < values[0]:
        axes.invert_xaxis()
    axes.set_ylim(-1, 1)
    axes.axhline(0, color="0.85", lw=0.6, zorder=0)
    for name, (colour, span, _) in LIMIT_TICKS.items():
        limit = float(points[name].iloc[0])
        if low - pad <= limit <= high + pad:
            axes.plot([limit, limit], span, color=colour, lw=1.5, zorder=5)
    height = _stagger_points(
        values, points["kind"].isin(BROKEN_KINDS).to_numpy(), CROWDED_SHARE * (high - low)
    )
    for kind, (mark, colour) in OUTCOME_MARKS.items():
        has_kind = (points["kind"] == kind).to_numpy()
        axes.plot(
            values[has_kind], height[has_kind], mark, color=colour, ms=6, mec=_edge_colour(colour), mew=0.6
        )
    marked = _choose_ticks(values)
    axes.set_xticks(marked, [_format_axis_value(value) for value in marked])
    axes.set_yticks([])
    axes.tick_params(axis="x", length=2, pad=1.5)
    axes.spines[["top", "left", "right"]].set_visible(False)


def _choose_ticks(values: Array) -> Array:
    """Powers of 10 or, on a short axis, the values themselves where they are apart."""
    low = values.min()
    width = np.ptp(values)
    if width <= 2:
        ticks = np.unique(values)
        return ticks[np.diff(ticks, prepend=-np.inf) > MIN_TICK_SHARE * width]
    step = next(step for step in TICK_STEPS if step * MAX_TICK_STEPS >= width)
    return np.arange(np.ceil(low / step), np.floor(values.max() / step) + 1) * step


def _stagger_points(values: Array, broken: Mask, near: float) -> Array:
    """The heights of points: 0, but in a run of near points right ones are up and broken ones down.

    Where all in a run are alike they are up and down in turn.
    """
    height = np.zeros(len(values))
    runs = np.cumsum(np.abs(np.diff(values, prepend=values[0])) >= near)
    for run in np.unique(runs):
        members = np.flatnonzero(runs == run)
        mixed = 0 < np.count_nonzero(broken[members]) < len(members)
        down = broken[members] if mixed else np.arange(len(members)) % 2 == 1
        height[members] = np.where(down, -0.5, 0.5) if len(members) > 1 else 0.0
    return height


def _format_axis_value(exponent: float) -> str:
    """10^exponent as readers like it."""
    if abs(exponent - round(exponent)) < WHOLE_POWER_TOLERANCE and abs(exponent) > 2:
        return rf"$10^{{{round(exponent)}}}$"
    value = 10**exponent
    return style.format_fraction(value) if value < 1 else f"{value:.3g}"
