"""All claims at a glance: the margin of each, and what the study says of it."""

from __future__ import annotations

import re

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator, NullFormatter

from study import style
from study.ledger import records

ROW = 0.42
ABOVE = 1.6
BELOW = 1.7
"""The heights in cm of a row, of the legend, and of the axis with the note."""
IDS = 1.25
WORDS = 5.3
SCALE = 2.75
"""The widths in cm of the ids, of the ids with the titles, and of the axis."""
KINDS = {
    "holds": ("o", style.COLOURS[0]),
    "holds, and is sharp": ("s", style.COLOURS[2]),
    "needs a condition that is left out": ("^", style.COLOURS[1]),
    "is an error of the source": ("X", "black"),
    "supported by numbers": ("D", style.COLOURS[3]),
    "not contradicted": ("v", style.COLOURS[6]),
    "not judged": ("P", "red"),
    "fails": ("*", "red"),
}
BEGINNINGS = {
    records.FAILS: "fails",
    records.UNJUDGED: "not judged",
    "is an error": "is an error of the source",
    "needs": "needs a condition that is left out",
    "is supported": "supported by numbers",
    "is not contradicted": "not contradicted",
}
"""The kind of a verdict, by how it begins; the kind of any other depends on whether it says `sharp`."""


def table(claims: style.FilePath) -> pd.DataFrame:
    """One row per claim that has a check: id, title, kind of its verdict, margin, within the axis' limits."""
    measured = [each for each in records.read(claims) if not each["verdict"].startswith(records.UNMEASURED)]
    found = pd.DataFrame(measured)
    margin = found["margin"].astype(float).fillna(records.LEAST).clip(records.LEAST, records.PLENTY)
    return found[["id", "title"]].assign(kind=found["verdict"].map(_kind), margin=margin)


def _kind(verdict: str) -> str:
    for start, kind in BEGINNINGS.items():
        if verdict.startswith(start):
            return kind
    return "holds, and is sharp" if re.search(r"(?<!not )\bsharp\b", verdict) else "holds"


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """A row per claim: its margin on a logarithmic axis, with a mark that tells the verdict.

    Columns: id and title of the claim, kind (of the verdict), margin (relative, within the axis).
    """
    data = style.read(csv_path)
    half = (len(data) + 1) // 2
    height = ROW * half + ABOVE + BELOW
    least = data["margin"].min()
    most = data["margin"].max()
    with style.figure_in(svg_path, height) as figure:
        for left, rows in ((0.1, data[:half]), (8.8, data[half:])):
            axes = style.axes_at(figure, left + WORDS, BELOW, SCALE, ROW * half)
            _panel(axes, rows, half)
            axes.set_xlim(least / 1.6, most * 1.6)
        marks = {kind: mark for kind, mark in KINDS.items() if kind in set(data["kind"])}
        handles = [
            style.key(kind, ls="", marker=mark, color=colour, mec="white")
            for kind, (mark, colour) in marks.items()
        ]
        style.legend(figure, handles, 0.1, height, ncols=3, borderpad=None, borderaxespad=None)
        ends = f"below {least:g} and above {most:g} they are drawn there"
        told = f"Margins are relative to what is required; {ends}; counts that have to be 0 have none."
        style.note(figure, told)


def _panel(axes: Axes, rows: pd.DataFrame, places: int) -> None:
    """Draw the rows, from the top of a panel with so many places."""
    heights = [places - 1 - k for k in range(len(rows))]
    beside: style.Look = {
        "transform": axes.get_yaxis_transform(),
        "fontsize": style.SMALL,
        "va": "center_baseline",
    }
    for y, row in zip(heights, rows.itertuples(), strict=True):
        marker, colour = KINDS[row.kind]
        axes.plot(row.margin, y, marker, color=colour, ms=5.5, mec="white", mew=0.5)
        for left, text in ((0, row.id), (IDS, row.title)):
            axes.text((left - WORDS) / SCALE, y, text, **beside)
    axes.set_yticks(heights, [])
    axes.tick_params(left=False)
    axes.set_ylim(-0.7, places - 0.3)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(100))
    axes.xaxis.set_minor_locator(LogLocator(10))
    axes.xaxis.set_minor_formatter(NullFormatter())
    style.light_grid(axes)
    axes.set_xlabel("relative margin")
