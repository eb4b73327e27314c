"""The inf-sup constant: over h/H, over delta of Theorem 5, and beside the bound that needs no eigenvalues."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from study import style, tables
from unilateral.formulas.decimals import format_up
from unilateral.norms.resolution import RULE

PAIR_COLUMNS = [
    "h_over_H",
    "edges_per_cell",
    "cell_over_edge",
    "smallest_angle",
    "delta",
    "alpha_1",
    "beta_lower",
    "beta_upper",
    "beta_fortin",
]
PANEL_LEFTS_CM = (1.25, 6.5, 12.25)
PANEL_WIDTH_CM = 4.4
PANEL_HEIGHT_CM = 4.9
"""The left ends of the panels, their width and their height, in cm."""
PAIR_LOOKS: dict[str, style.Look] = {
    "irregular": {"marker": "o", "ms": 3.2, "mew": 0.6, "ls": "", "color": "0.55", "mfc": "white"},
    "regular": {"marker": "o", "ms": 3.6, "mew": 0.4, "ls": "", "color": "0.25", "mec": "white"},
    "uniform": {"marker": "s", "ms": 3.6, "mew": 0.4, "ls": "", "color": style.COLOURS[0], "mec": "white"},
    "worst": {"marker": "x", "ms": 5.0, "mew": 1.4, "ls": "", "color": style.COLOURS[1]},
}
MAX_REGULAR_ALPHA_1 = 10
"""`regular` pairs have neighbouring cells within this ratio, and the angles of RULE, as claim T.node says."""
PAIR_LABELS = {
    "uniform": "uniform",
    "regular": rf"other ones, angles $\geq {RULE.smallest_angle:g}°$, "
    f"neighbouring cells within {MAX_REGULAR_ALPHA_1}:1",
    "irregular": "other ones, smaller angles or larger ratios",
    "worst": "the worst that searches found",
}
GUIDE_LOOK: style.Look = {"color": "0.25", "lw": 0.8, "ls": (0, (4, 2)), "zorder": 1}


def table(surveys: Sequence[style.FilePath], families: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """One row per survey, partition and mesh; `families` have the label and kind of each survey, by name.

    `widest` is the largest beta_upper/beta_lower - 1 of all.
    """
    survey_rows = [
        tables.load_table(path)[PAIR_COLUMNS]
        .to_dataframe(["partition", "mesh"])
        .assign(scene=name, label=family["label"], kind=family["kind"])
        for (name, family), path in zip(families.items(), surveys, strict=True)
    ]
    rows = pd.concat(survey_rows)[["scene", "label", "kind", "H", *PAIR_COLUMNS]]
    is_positive = rows["beta_lower"] > 0
    return rows.assign(widest=(rows["beta_upper"] / rows["beta_lower"] - 1)[is_positive].max())


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """beta over h/H and over delta; and over beta the bound without eigenvalues, where there is one.

    Columns: kind (uniform, local, worst), h_over_H, delta (the smallest over the cells), alpha_1,
    smallest_angle, beta_lower, beta_fortin; and, for the note, beta_upper and widest (largest
    beta_upper/beta_lower - 1), if known.
    """
    data = style.read_figure_table(csv_path)
    # The look of a pair is its kind; of the other ones it is whether they are regular
    regular = (data["smallest_angle"] >= RULE.smallest_angle) & (data["alpha_1"] <= MAX_REGULAR_ALPHA_1)
    look = data["kind"].where(data["kind"] != "local", np.where(regular, "regular", "irregular"))
    data = data.assign(look=look)
    bottom = 3.0
    with style.open_figure(svg_path, bottom + PANEL_HEIGHT_CM + 0.65) as figure:
        ratio, inner, unsolved = [
            style.add_axes(figure, left_cm, bottom, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            for left_cm in PANEL_LEFTS_CM
        ]
        _draw_over_ratio(ratio, data)
        _draw_over_delta(inner, data)
        _draw_bound(unsolved, data[data["beta_fortin"] > 0])
        handles = [style.legend_entry(label, **PAIR_LOOKS[kind]) for kind, label in PAIR_LABELS.items()]
        style.add_legend(figure, handles, PANEL_LEFTS_CM[0] - 0.8, bottom - 1.25, ncols=2, labelspacing=0.5)
        note = r"$\beta$: its lower bound by eigenvalues"
        if "widest" in data:
            note += f"; the upper one is at most {format_up(100 * data['widest'].max(), '.2g')} % higher"
        style.add_note(figure, f"{note}.")


def _draw_over_ratio(axes: Axes, data: pd.DataFrame) -> None:
    """Draw beta over h/H, with a line at h = H."""
    _draw_pairs(axes, data, "h_over_H", "beta_lower")
    axes.set(title="$h/H$ does not decide", xlabel="$h/H$", ylabel=r"$\beta$")
    axes.set_xscale("log", base=2)
    axes.set_xlim(data["h_over_H"].min() / 1.2, data["h_over_H"].max() * 1.2)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(lambda value, _: f"${style.format_fraction(value)}$")
    axes.axvline(1, **GUIDE_LOOK)


def _draw_over_delta(axes: Axes, data: pd.DataFrame) -> None:
    """Draw beta over delta from 0 to 1/2, with the bound of claim T.node."""
    _draw_pairs(axes, data, "delta", "beta_lower")
    delta = np.linspace(0, 0.5)
    axes.plot(delta, delta * (1 - delta), **GUIDE_LOOK)
    axes.text(0.3, 0.18, r"$\delta(1-\delta)$", ha="left", va="top", fontsize=style.SMALL_FONT_POINTS)
    axes.set(title=r"$\delta$ bounds it below", xlabel=r"$\delta$", xlim=(-0.012, 0.512))
    axes.tick_params(labelleft=False)


def _draw_bound(axes: Axes, data: pd.DataFrame) -> None:
    """Draw the bound without eigenvalues over beta, with lines where it is beta, and a quarter of it."""
    _draw_pairs(axes, data, "beta_lower", "beta_fortin")
    for factor, text, place in ((1, r"$\beta$", (0.53, 0.6)), (0.25, r"$\beta/4$", (0.95, 0.15))):
        axes.plot([0, 1], [0, factor], **GUIDE_LOOK)
        axes.text(*place, text, fontsize=style.SMALL_FONT_POINTS, ha="center")
    axes.set(title="a bound without eigenvalues", xlabel=r"$\beta$", xlim=(-0.03, 1.03))
    axes.tick_params(labelleft=False)


def _draw_pairs(axes: Axes, data: pd.DataFrame, x: str, y: str) -> None:
    for kind, look in PAIR_LOOKS.items():
        pairs = data[data["look"] == kind]
        axes.plot(pairs[x], pairs[y], **look)
    axes.set_ylim(-0.03, 1.03)
    style.draw_light_grid(axes)
