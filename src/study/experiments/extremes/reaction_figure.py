"""Guaranteed bounds over the error, over c/k: a panel per case."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from study import style, tables
from study.formats import format_value

PANEL_LEFTS_CM = (1.25, 5.15, 9.05, 12.95)
PANEL_WIDTH_CM = 3.45
PANEL_BOTTOM_CM = 2.1
PANEL_HEIGHT_CM = 4.6
"""The left ends of the panels, their width, their lower end and their height, in cm."""
INDEX_TICKS = (1, 1.2, 1.5, 2, 3, 5, 10)
LABELLED_POWERS = (-8, 0, 8, 16)
POWER_LIMITS = (-9, 17)
"""Powers of 10 of c/k that the axis shows: for smaller ones the bounds are those for c = 0 (claim X.tiny)."""
BOUND_LOOKS: dict[str, style.Look] = {
    "cheap": {"ls": "-", "lw": 1.0, "ms": 3.2, "mew": 0.6},
    "sharp": {"ls": (0, (3, 2)), "lw": 0.8, "ms": 3.2, "mew": 0.6, "mfc": "white"},
}
"""The lines of both bounds."""


def table(reaction: style.FilePath) -> pd.DataFrame:
    """A row per case, bound, mesh and c/k > 0, with the index: the bound over the error."""
    stored = tables.load_table(reaction)
    positive = stored.sel(c_over_k=stored["c_over_k"] > 0)
    indices = [
        (positive[f"{bound}_bound"] / positive["energy_error"])
        .rename("index")
        .to_dataframe()
        .assign(bound=bound)
        for bound in BOUND_LOOKS
    ]
    rows = pd.concat(indices).reset_index()
    rows["log10_value"] = np.log10(rows["c_over_k"])
    return rows[["case", "bound", "h", "log10_value", "index"]]


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """The index over c/k on logarithmic scales, a panel per case, a colour per h.

    Columns: case, bound (cheap, sharp), h, log10_value (of c/k), index.
    """
    data = style.read_figure_table(csv_path)
    sizes = sorted(data["h"].unique(), reverse=True)
    limits = (0.98, 1.05 * data["index"].max())
    with style.open_figure(svg_path, PANEL_BOTTOM_CM + PANEL_HEIGHT_CM + 0.7) as figure:
        for left_cm, (case, rows) in zip(PANEL_LEFTS_CM, data.groupby("case", sort=False), strict=True):
            axes = style.add_axes(figure, left_cm, PANEL_BOTTOM_CM, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            _draw_indices(axes, rows, sizes)
            axes.set_ylim(limits)
            axes.set_title(str(case))
            if left_cm == PANEL_LEFTS_CM[0]:
                axes.set_ylabel("bound over error")
            else:
                axes.tick_params(labelleft=False)
        handles = [
            style.legend_entry(f"$h={format_value(h, '1/n')}$", **style.numbered_look(i), ms=3.2)
            for i, h in enumerate(sizes)
        ]
        handles += [
            style.legend_entry(f"{bound} bound", color="0.25", marker="o", **look)
            for bound, look in BOUND_LOOKS.items()
        ]
        style.add_legend(figure, handles, PANEL_LEFTS_CM[0] - 0.8, PANEL_BOTTOM_CM - 1.3, ncols=5)


def _draw_indices(axes: Axes, rows: pd.DataFrame, sizes: list[float]) -> None:
    axes.set_yscale("log")
    for (bound, h), line in rows.groupby(["bound", "h"], sort=False):
        look = {**style.numbered_look(sizes.index(h)), **BOUND_LOOKS[str(bound)]}
        axes.plot(line["log10_value"], line["index"], **look)
    axes.set_xticks(LABELLED_POWERS, [rf"$10^{{{power}}}$" if power else "1" for power in LABELLED_POWERS])
    axes.set_xlim(POWER_LIMITS)
    axes.set_xlabel("$c/k$")
    axes.set_yticks(INDEX_TICKS, [f"{tick:g}" for tick in INDEX_TICKS])
    axes.yaxis.set_minor_locator(NullLocator())
    style.draw_light_grid(axes)
