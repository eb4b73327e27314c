"""Guaranteed bounds over the error, over c/k: a panel per case."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from study import style, tables
from study.formats import shown

LEFT = (1.25, 5.15, 9.05, 12.95)
WIDTH = 3.45
BOTTOM = 2.1
HEIGHT = 4.6
"""The left ends of the panels, their width, their lower end and their height, in cm."""
TICKS = (1, 1.2, 1.5, 2, 3, 5, 10)
POWERS = (-8, 0, 8, 16)
RANGE = (-9, 17)
"""Powers of 10 of c/k that the axis shows: for smaller ones the bounds are those for c = 0, see X.tiny."""
BOUNDS: dict[str, style.Look] = {
    "cheap": {"ls": "-", "lw": 1.0, "ms": 3.2, "mew": 0.6},
    "sharp": {"ls": (0, (3, 2)), "lw": 0.8, "ms": 3.2, "mew": 0.6, "mfc": "white"},
}
"""The lines of both bounds."""


def table(reaction: style.FilePath) -> pd.DataFrame:
    """A row per case, bound, mesh and c/k > 0, with the index: the bound over the error."""
    stored = tables.load(reaction)
    positive = stored.sel(c_over_k=stored["c_over_k"] > 0)
    indices = [
        (positive[f"{bound}_bound"] / positive["energy_error"])
        .rename("index")
        .to_dataframe()
        .assign(bound=bound)
        for bound in BOUNDS
    ]
    rows = pd.concat(indices).reset_index()
    rows["log10_value"] = np.log10(rows["c_over_k"])
    return rows[["case", "bound", "h", "log10_value", "index"]]


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """The index over c/k on logarithmic scales, a panel per case, a colour per h.

    Columns: case, bound (cheap, sharp), h, log10_value (of c/k), index.
    """
    data = style.read(csv_path)
    sizes = sorted(data["h"].unique(), reverse=True)
    limits = (0.98, 1.05 * data["index"].max())
    with style.figure_in(svg_path, BOTTOM + HEIGHT + 0.7) as figure:
        for left, (case, rows) in zip(LEFT, data.groupby("case", sort=False), strict=True):
            axes = style.axes_at(figure, left, BOTTOM, WIDTH, HEIGHT)
            _lines(axes, rows, sizes)
            axes.set_ylim(limits)
            axes.set_title(str(case))
            if left == LEFT[0]:
                axes.set_ylabel("bound over error")
            else:
                axes.tick_params(labelleft=False)
        handles = [style.key(f"$h={shown(h, '1/n')}$", **style.look(i), ms=3.2) for i, h in enumerate(sizes)]
        handles += [
            style.key(f"{bound} bound", color="0.25", marker="o", **look) for bound, look in BOUNDS.items()
        ]
        style.legend(figure, handles, LEFT[0] - 0.8, BOTTOM - 1.3, ncols=5)


def _lines(axes: Axes, rows: pd.DataFrame, sizes: list[float]) -> None:
    axes.set_yscale("log")
    for (bound, h), line in rows.groupby(["bound", "h"], sort=False):
        look = {**style.look(sizes.index(h)), **BOUNDS[str(bound)]}
        axes.plot(line["log10_value"], line["index"], **look)
    axes.set_xticks(POWERS, [rf"$10^{{{power}}}$" if power else "1" for power in POWERS])
    axes.set_xlim(RANGE)
    axes.set_xlabel("$c/k$")
    axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    axes.yaxis.set_minor_locator(NullLocator())
    style.light_grid(axes)
