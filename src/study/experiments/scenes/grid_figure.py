"""Maps of the errors over (h, H), which show the floors that either size leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke

from study import style, tables

MAX_LUMINANCE_FOR_WHITE = 0.179  # the luminance at which black and white contrast equally (WCAG 2.1, 1.4.3)
PANEL_LEFTS_CM = (1.62, 6.74, 11.86)
MAP_WIDTH_CM = 4.6
MAP_ROW_CM = 0.53
MAP_GAP_CM = 0.62
DRAWN_RATIOS = (0.5, 1.0, 2.0)
DASH_ENDS = np.array([[-0.11, -0.11], [0.11, 0.11]])
"""The ends of a dash as seen from the corner of a cell, along its diagonal."""
BLANK_LOOK: style.Look = {"fc": "white", "ec": "0.8", "hatch": "////"}


def table(errors: style.FilePath, cases: Sequence[str]) -> pd.DataFrame:
    """One row per case, norm, h and H: the error, NaN where it was not computed, and whether beta = 0."""
    runs = tables.load_table(errors).sel(case=list(cases))
    without_beta = (runs["algorithm"] == "active_set").astype(int)
    columns = xr.Dataset({"error": tables.errors_in_all_norms(runs), "beta_zero": without_beta})
    rows = columns.to_dataframe(["case", "norm", "mesh", "partition"]).reset_index()
    return rows[["case", "norm", "h", "H", "h_over_H", "error", "beta_zero"]]


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Maps of the errors over (h, H): a row of maps per case, a column per norm.

    Columns: case, norm (h1, hm12, l2), h, H, h_over_H, error (empty if not computed), beta_zero (0, 1).
    """
    data = style.read_figure_table(csv_path)
    cases = data["case"].unique()
    row_step = MAP_ROW_CM * data["H"].nunique() + MAP_GAP_CM
    with style.open_figure(svg_path, 3.55 + row_step * len(cases)) as figure:
        for left_cm, norm in zip(PANEL_LEFTS_CM, style.NORM_TITLES, strict=True):
            _draw_norm_column(figure, left_cm, data[data["norm"] == norm], cases)
        handles = [
            style.legend_entry("constant $h/H$", color="black", lw=0.8),
            Rectangle((0, 0), 1, 1, **BLANK_LOOK),
        ]
        blank = r"not computed        underlined: $\beta=0$, where $\lambda_H$ is not judged"
        figure.legend(handles, ["constant $h/H$", blank], loc="lower center", ncols=2)


def _draw_norm_column(figure: Figure, left_cm: float, rows: pd.DataFrame, cases: Sequence[str]) -> None:
    """Draw the maps of all cases in one norm, with one scale of colours; the first column has names."""
    norm = rows["norm"].iloc[0]
    h = np.sort(rows["h"].unique())[::-1]
    H = np.sort(rows["H"].unique())[::-1]
    height = MAP_ROW_CM * len(H)
    row_step = height + MAP_GAP_CM
    positive = rows["error"][rows["error"] > 0]
    low, high = (positive.min(), positive.max()) if len(positive) else (0.1, 1.0)
    scale = ScalarMappable(LogNorm(low, high), colormaps["cividis"])
    for i, case in enumerate(cases):
        bottom = 2.05 + row_step * len(cases) - height - i * row_step
        axes = style.add_axes(figure, left_cm, bottom, MAP_WIDTH_CM, height)
        _draw_error_map(axes, rows[rows["case"] == case], h, H, scale)
        axes.set_xticks(range(len(h)), _format_sizes(h) if i == 0 else [])
        axes.set_yticks(range(len(H)), _format_sizes(H) if norm == "h1" else [])
        if norm == "h1":
            middle: style.Look = {"transform": axes.transAxes, "rotation": 90, "ha": "center", "va": "center"}
            axes.set_ylabel("cell size $H$", labelpad=1)
            axes.text(-0.31, 0.5, case, **middle)
        if i == 0:
            axes.set_xlabel("mesh size $h$", labelpad=4)
            axes.set_title(style.NORM_TITLES[norm], pad=6)
    bar = style.add_axes(figure, left_cm, 1.45, MAP_WIDTH_CM, 0.25)
    style.simplify_colour_bar(figure.colorbar(scale, cax=bar, orientation="horizontal"))


def _format_sizes(sizes: np.ndarray) -> list[str]:
    return [f"${style.format_fraction(size)}$" for size in sizes]


def _draw_error_map(
    axes: Axes, rows: pd.DataFrame, h: np.ndarray, H: np.ndarray, scale: ScalarMappable
) -> None:
    """One case in one norm: h from left to right, H from top to bottom, both from coarse to fine."""
    axes.set(xlim=(-0.5, len(h) - 0.5), ylim=(len(H) - 0.5, -0.5))
    axes.tick_params(length=0, pad=3)
    axes.xaxis.tick_top()
    axes.xaxis.set_label_position("top")
    axes.add_patch(Rectangle((-0.5, -0.5), len(h), len(H), lw=0, **BLANK_LOOK))
    column = dict(zip(h, range(len(h)), strict=True))
    row = dict(zip(H, range(len(H)), strict=True))
    places = np.column_stack([rows["h"].map(column), rows["H"].map(row)])
    for (j, i), error, beta_zero in zip(places.tolist(), rows["error"], rows["beta_zero"], strict=True):
        _draw_cell(axes, j, i, error, bool(beta_zero), scale)
    for ratio in DRAWN_RATIOS:
        has_ratio = np.isclose(rows["h_over_H"], ratio, rtol=1e-3)
        _draw_diagonal(axes, sorted(places[has_ratio].tolist()), ratio)


def _draw_cell(axes: Axes, j: int, i: int, error: float, beta_zero: bool, scale: ScalarMappable) -> None:
    if np.isnan(error) and not beta_zero:
        return
    colour = scale.to_rgba(np.array(error)) if error > 0 else (1.0, 1.0, 1.0, 1.0)
    luminance = np.dot(np.power(colour[:3], 2.2), (0.2126, 0.7152, 0.0722))
    ink = "white" if luminance < MAX_LUMINANCE_FOR_WHITE else "black"
    axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1, 1, fc=colour, ec="white" if error > 0 else "0.8", lw=0.5))
    if beta_zero and not np.isnan(error):
        axes.plot([j - 0.38, j + 0.38], [i + 0.31, i + 0.31], color=ink, lw=0.8, zorder=6)
    behind = {"fc": colour, "lw": 0, "pad": 0.2}
    if np.isnan(error):
        label = r"$\beta=0$"
    elif error:  # two significant digits: 1.3e-4
        mantissa, exponent = f"{error:.1e}".split("e")
        label = f"{mantissa}e{int(exponent)}"
    else:
        label = "0"
    axes.text(j, i, label, color=ink, fontsize=8, ha="center", va="center", zorder=5, bbox=behind)


def _draw_diagonal(axes: Axes, places: list[list[int]], ratio: float) -> None:
    """Dashes where cells of the same h/H touch, away from their numbers; the ratio at the fine end."""
    if len(places) < 2:
        return
    halo = [withStroke(linewidth=2.4, foreground="white")]
    for corner in np.array(places) + 0.5:
        axes.plot(*(corner + DASH_ENDS).T, color="black", lw=1.1, clip_on=False, zorder=4, path_effects=halo)
    beside: style.Look = {"textcoords": "offset points", "fontsize": style.SMALL_FONT_POINTS, "va": "top"}
    axes.annotate(f"${style.format_fraction(ratio)}$", corner, (3, -3), **beside)
