"""Errors and bounds over the number of unknowns, on uniform meshes and on adapted ones, and beta on these."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from study import style, tables
from study.scenes import has_clamped_sides

COLUMNS = ["case", "kind", "level", "unknowns", "error", "bound", "beta", "beta_of_edges"]
PANEL_LEFTS_CM = (1.25, 6.95, 12.65)
PANEL_WIDTH_CM = 4.15
PANEL_HEIGHT_CM = 4.3
PANEL_BOTTOM_CM = 2.65
PANEL_ROW_CM = 6.1
MESH_LOOKS: dict[str, style.Look] = {
    "uniform": {"color": style.COLOURS[1], "marker": "s"},
    "adapted": {"color": style.COLOURS[0], "marker": "o"},
}
BOUND_LOOK: style.Look = {"ls": style.LINE_STYLES[1], "mfc": "white"}
OPTIMAL_SLOPE = -0.5
TRIANGLE_SPAN = 8.0
"""The slope that the triangles show, and the factor by which unknowns grow along their base."""


def table(errors: style.FilePath, infsup: style.FilePath) -> pd.DataFrame:
    """A row per case, kind of mesh and level: unknowns, the error, its bound, beta from below.

    Cases with clamped sides are left out. `beta_of_edges` is an upper bound on beta with the edges as cells.
    What is not known is NaN.
    """
    measured = tables.load_table(errors)
    constants = tables.load_table(infsup)
    columns = xr.Dataset(
        {
            "unknowns": measured["unknowns"],
            "error": measured["h1_error"],
            "bound": measured["h1_bound"],
            "beta": constants["beta_lower"],
            "beta_of_edges": constants["beta_of_edges"],
        }
    )
    columns = columns.sel(case=[name for name in columns["case"].values if not has_clamped_sides(name)])
    rows = columns.to_dataframe(["case", "kind", "level"]).reset_index()
    return rows[rows["unknowns"].notna()].astype({"unknowns": int})[COLUMNS]


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """A panel per case, of errors and bounds, and one of beta on the adapted meshes of all cases.

    Columns: case, kind (uniform, adapted), level, unknowns, error, bound, beta, beta_of_edges.
    """
    data = style.read_figure_table(csv_path)
    cases = list(dict.fromkeys(data["case"]))
    n_rows = len(cases) // len(PANEL_LEFTS_CM) + 1
    places = [
        (left_cm, PANEL_BOTTOM_CM + PANEL_ROW_CM * k)
        for k in range(n_rows)[::-1]
        for left_cm in PANEL_LEFTS_CM
    ]
    with style.open_figure(svg_path, PANEL_BOTTOM_CM + PANEL_ROW_CM * n_rows - 1) as figure:
        for case, place in zip(cases, places, strict=False):
            axes = style.add_axes(figure, *place, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            axes.set_title(case)
            _draw_case(axes, data[data["case"] == case])
            _set_unknowns_axis(axes, data["unknowns"])
        axes = style.add_axes(figure, *places[len(cases)], PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
        axes.set_title(r"$\beta$ on adapted meshes")
        _draw_beta(axes, data[data["beta"].notna()], cases)
        _set_unknowns_axis(axes, data["unknowns"])
        _add_mesh_keys(figure, cases)


def _draw_case(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the errors and bounds of one case on both kinds of meshes, and the optimal slope."""
    axes.set_yscale("log")
    for kind, look in MESH_LOOKS.items():
        levels = rows[rows["kind"] == kind]
        axes.plot(levels["unknowns"], levels["bound"], lw=1.0, ms=3.4, mew=0.9, **look, **BOUND_LOOK)
        axes.plot(levels["unknowns"], levels["error"], lw=1.1, ms=3.4, mew=0.9, **look)
    _draw_optimal_slope(axes, rows)
    style.set_plain_ticks(axes.yaxis)


def _draw_beta(axes: Axes, rows: pd.DataFrame, cases: list[str]) -> None:
    """Draw beta of all cases as lines, and beta with the edges as cells as marks."""
    for i, case in enumerate(cases):
        levels = rows[rows["case"] == case]
        axes.plot(levels["unknowns"], levels["beta"], lw=1.0, ms=3.4, mew=0.9, **style.numbered_look(i))
        marks: style.Look = {**style.numbered_look(i), "ls": "", "ms": 2.6, "mew": 0.7, "mfc": "white"}
        axes.plot(levels["unknowns"], levels["beta_of_edges"], **marks)
    axes.set_ylim(-0.05, 1.0)


def _set_unknowns_axis(axes: Axes, unknowns: pd.Series) -> None:
    """Set the horizontal axis, which is the same in all panels."""
    axes.set_xscale("log")
    axes.set_xlim(unknowns.min() / 1.5, unknowns.max() * 1.5)
    axes.xaxis.set_minor_locator(LogLocator(subs=range(2, 10)))
    axes.set_xlabel("unknowns $N$", labelpad=1)
    style.draw_light_grid(axes)


def _draw_optimal_slope(axes: Axes, rows: pd.DataFrame) -> None:
    """The triangle of the optimal slope, at the left, below all lines."""
    x0 = 1.3 * rows["unknowns"].min()
    near = rows[rows["unknowns"] < TRIANGLE_SPAN * x0]
    values = np.fmin(near["error"], near["bound"])
    top = 0.6 * float((values * (near["unknowns"] / x0) ** -OPTIMAL_SLOPE).min())
    x1 = TRIANGLE_SPAN * x0
    base = top * TRIANGLE_SPAN**OPTIMAL_SLOPE
    axes.fill([x0, x1, x0], [top, base, base], fc="0.88", ec="0.25", lw=0.7)
    beside: style.Look = {"textcoords": "offset points", "fontsize": style.SMALL_FONT_POINTS}
    axes.annotate("$2$", (np.sqrt(x0 * x1), base), (0, -2), ha="center", va="top", **beside)
    axes.annotate("$1$", (x0, np.sqrt(top * base)), (-3, 0), ha="right", va="center", **beside)


def _add_mesh_keys(figure: Figure, cases: list[str]) -> None:
    entries = [
        style.legend_entry(f"{kind}: {quantity}", ms=4, mew=0.9, lw=1.1, **look, **quantity_look)
        for kind, look in MESH_LOOKS.items()
        for quantity, quantity_look in ((style.NORM_TITLES["h1"], {}), ("guaranteed bound", BOUND_LOOK))
    ]
    beta_entries = [
        style.legend_entry(case, ms=4, lw=1.0, **style.numbered_look(i)) for i, case in enumerate(cases)
    ]
    beta_entries.append(
        style.legend_entry("cells of one edge", ls="", ms=4, mew=0.9, marker="o", color="0.25", mfc="white")
    )
    style.add_legend(figure, entries, 1.25, 1.45, ncols=2, columnspacing=1.6)
    style.add_legend(figure, beta_entries, 11.2, 1.45, ncols=2, columnspacing=1.2)
