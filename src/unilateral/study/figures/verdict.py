"""All claims at a glance: how far each is on its side, and what the study says of it."""

from __future__ import annotations

import re

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from unilateral.study.figures.style import (
    COLOURS,
    SMALL,
    WIDTH,
    FilePath,
    axes_at,
    figure_in,
    light_grid,
    read,
)
from unilateral.study.judge import records

ROW, ABOVE, BELOW = 0.42, 1.6, 1.7
"""Centimetres: of a row, of the legend, of the axis and the note."""
KINDS = {
    "holds": ("o", COLOURS[0]),
    "holds, and is sharp": ("s", COLOURS[2]),
    "needs a condition that is left out": ("^", COLOURS[1]),
    "is an error of the source": ("X", "black"),
    "supported beyond the paper": ("D", COLOURS[3]),
    "not contradicted": ("v", COLOURS[6]),
    "not judged": ("P", "red"),
    "fails": ("*", "red"),
}
BEGINNINGS = {
    records.FAILS: "fails",
    records.UNJUDGED: "not judged",
    "is an error": "is an error of the source",
    "needs": "needs a condition that is left out",
    "is supported": "supported beyond the paper",
    "is not contradicted": "not contradicted",
}
"""Kinds by how a verdict begins; of others it counts whether they say `sharp`."""


def table(claims: FilePath) -> pd.DataFrame:
    """One row per claim: label, kind of its verdict, margin, within the limits of the axis."""
    rows = []
    for each in records.read(claims):
        margin = min(max(each["margin"] or records.LEAST, records.LEAST), records.PLENTY)
        rows.append({"label": each["id"], "kind": _kind(each["verdict"]), "margin": margin})
    return pd.DataFrame(rows)


def _kind(verdict: str) -> str:
    for start, kind in BEGINNINGS.items():
        if verdict.startswith(start):
            return kind
    return "holds, and is sharp" if re.search(r"(?<!not )\bsharp\b", verdict) else "holds"


def draw(csv_path: FilePath, svg_path: FilePath) -> None:
    """A row per claim, its margin on a logarithmic axis, its mark what was found.

    Columns: label (the claim), kind (of the verdict), margin (relative, within the axis).
    """
    data = read(csv_path)
    half = (len(data) + 1) // 2
    panel = ROW * half
    height = panel + ABOVE + BELOW
    limits = data["margin"].min(), data["margin"].max()
    with figure_in(svg_path, height) as figure:
        for left, rows in ((1.6, data[:half]), (10.1, data[half:])):
            _panel(axes_at(figure, left, BELOW, 6.6, panel), rows, half, limits)
        _legend(figure, height, [kind for kind in KINDS if kind in set(data["kind"])])
        note = f"Margins below {limits[0]:g} and above {limits[1]:g} are drawn there; "
        note += "counts that have to be 0 have none."
        figure.text(0.1 / WIDTH, 0.2 / height, note, fontsize=SMALL)


def _panel(axes: Axes, rows: pd.DataFrame, places: int, limits: tuple[float, float]) -> None:
    """The rows from the top of so many places."""
    heights = [places - 1 - k for k in range(len(rows))]
    for y, row in zip(heights, rows.itertuples(), strict=True):
        marker, colour = KINDS[row.kind]
        axes.plot(row.margin, y, marker, color=colour, ms=5.5, mec="white", mew=0.5)
    axes.set_yticks(heights, rows["label"])
    axes.set_ylim(-0.7, places - 0.3)
    axes.set_xscale("log")
    axes.set_xlim(limits[0] / 1.6, limits[1] * 1.6)
    light_grid(axes)
    axes.set_xlabel("margin, relative to what is required")


def _legend(figure: Figure, height: float, kinds: list[str]) -> None:
    handles = [
        Line2D([], [], ls="", marker=KINDS[kind][0], color=KINDS[kind][1], mec="white", label=kind)
        for kind in kinds
    ]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.1 / WIDTH, 1), ncols=3)
