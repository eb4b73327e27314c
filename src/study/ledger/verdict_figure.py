"""All claims at a glance: the margin of each, and what the study says of it."""

from __future__ import annotations

import re

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from study import style
from study.ledger import records

CLAIM_ROW_CM = 0.42
LEGEND_HEIGHT_CM = 1.6
PANEL_BOTTOM_CM = 1.7
"""The heights in cm of a row, of the legend, and of the axis with the note."""
ID_WIDTH_CM = 1.25
TITLE_WIDTH_CM = 5.3
PANEL_WIDTH_CM = 2.75
"""The widths in cm of the ids, of the ids with the titles, and of the axis."""
VERDICT_MARKS = {
    "holds": ("o", style.COLOURS[0]),
    "holds, and is sharp": ("s", style.COLOURS[2]),
    "needs a condition that is left out": ("^", style.COLOURS[1]),
    "is an error of the source": ("X", "black"),
    "supported by numbers": ("D", style.COLOURS[3]),
    "not contradicted": ("v", style.COLOURS[6]),
    "not judged": ("P", "red"),
    "fails": ("*", "red"),
}
KIND_BY_BEGINNING = {
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
    measured = [
        record
        for record in records.read_records(claims)
        if not record["verdict"].startswith(records.UNMEASURED)
    ]
    claims_table = pd.DataFrame(measured)
    margin = (
        claims_table["margin"]
        .astype(float)
        .fillna(records.MIN_TOLD_MARGIN)
        .clip(records.MIN_TOLD_MARGIN, records.MAX_TOLD_MARGIN)
    )
    return claims_table[["id", "title"]].assign(
        kind=claims_table["verdict"].map(_verdict_kind), margin=margin
    )


def _verdict_kind(verdict: str) -> str:
    for start, kind in KIND_BY_BEGINNING.items():
        if verdict.startswith(start):
            return kind
    return "holds, and is sharp" if re.search(r"(?<!not )\bsharp\b", verdict) else "holds"


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """A row per claim: its margin on a logarithmic axis, with a mark that tells the verdict.

    Columns: id and title of the claim, kind (of the verdict), margin (relative, within the axis).
    """
    data = style.read_figure_table(csv_path)
    half = (len(data) + 1) // 2
    height = CLAIM_ROW_CM * half + LEGEND_HEIGHT_CM + PANEL_BOTTOM_CM
    smallest = data["margin"].min()
    largest = data["margin"].max()
    with style.open_figure(svg_path, height) as figure:
        for left_cm, rows in ((0.1, data[:half]), (8.8, data[half:])):
            axes = style.add_axes(
                figure, left_cm + TITLE_WIDTH_CM, PANEL_BOTTOM_CM, PANEL_WIDTH_CM, CLAIM_ROW_CM * half
            )
            _draw_claims(axes, rows, half)
            axes.set_xlim(smallest / 1.6, largest * 1.6)
        handles = _list_legend_entries(set(data["kind"]))
        style.add_legend(figure, handles, 0.1, height, ncols=3, borderpad=None, borderaxespad=None)
        ends = f"below {smallest:g} and above {largest:g} they are drawn there"
        note = f"Margins are relative to what is required; {ends}; counts that have to be 0 have none."
        style.add_note(figure, note)


def _list_legend_entries(kinds: set[str]) -> list[Line2D]:
    """The marks of the kinds of verdicts that are drawn."""
    return [
        style.legend_entry(kind, ls="", marker=mark, color=colour, mec="white")
        for kind, (mark, colour) in VERDICT_MARKS.items()
        if kind in kinds
    ]


def _draw_claims(axes: Axes, rows: pd.DataFrame, n_places: int) -> None:
    """Draw the rows, from the top of a panel with so many places."""
    heights = [n_places - 1 - k for k in range(len(rows))]
    beside: style.Look = {
        "transform": axes.get_yaxis_transform(),
        "fontsize": style.SMALL_FONT_POINTS,
        "va": "center_baseline",
    }
    for y, row in zip(heights, rows.itertuples(), strict=True):
        marker, colour = VERDICT_MARKS[row.kind]
        axes.plot(row.margin, y, marker, color=colour, ms=5.5, mec="white", mew=0.5)
        for left_cm, text in ((0, row.id), (ID_WIDTH_CM, row.title)):
            axes.text((left_cm - TITLE_WIDTH_CM) / PANEL_WIDTH_CM, y, text, **beside)
    axes.set_yticks(heights, [])
    axes.tick_params(left=False)
    axes.set_ylim(-0.7, n_places - 0.3)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(100))
    axes.xaxis.set_minor_locator(LogLocator(10))
    axes.xaxis.set_minor_formatter(NullFormatter())
    style.draw_light_grid(axes)
    axes.set_xlabel("relative margin")
