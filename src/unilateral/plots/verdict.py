"""All claims at a glance: how far each is on its side, and what the study says of it."""

from __future__ import annotations

from matplotlib.lines import Line2D

from unilateral.errors import InputError
from unilateral.plots.style import COLOURS, SMALL, WIDTH, FilePath, axes_at, figure_in, read

COLUMNS = ("label", "kind", "margin")
KINDS = {
    "holds": ("o", COLOURS[0]),
    "holds, and is sharp": ("s", COLOURS[2]),
    "needs a condition that is left out": ("^", COLOURS[1]),
    "is an error of the source": ("X", "black"),
    "supported beyond the paper": ("D", COLOURS[3]),
    "not contradicted": ("v", COLOURS[6]),
    "fails": ("*", "red"),
}


def verdict(csv_path: FilePath, svg_path: FilePath) -> None:
    """A row per claim, its margin on a logarithmic axis, its mark what was found.

    Columns: label (the claim), kind (of the verdict), margin (relative, within the axis). Raises InputError
    for a table without them.
    """
    table = read(csv_path, COLUMNS)
    unknown = set(table["kind"]) - set(KINDS)
    if unknown:
        raise InputError(f"{csv_path}, column 'kind': '{min(unknown)}' is none of {', '.join(KINDS)}")
    rows = len(table)
    height = 2.9 + 0.42 * rows
    with figure_in(svg_path, height) as figure:
        axes = axes_at(figure, 1.6, 2.0, 9.6, 0.42 * rows)
        for y, row in enumerate(table[::-1].itertuples()):
            marker, colour = KINDS[row.kind]
            axes.plot(row.margin, y, marker, color=colour, ms=5.5, mec="white", mew=0.5)
        axes.set_yticks(range(rows), table["label"][::-1])
        axes.set_ylim(-0.7, rows - 0.3)
        axes.set_xscale("log")
        axes.set_xlim(table["margin"].min() / 1.6, table["margin"].max() * 1.6)
        axes.grid(which="major", color="0.9", lw=0.5)
        axes.set_axisbelow(True)
        axes.set(xlabel="margin, relative to what is required", title="every statement, judged")
        used = [kind for kind in KINDS if kind in set(table["kind"])]
        handles = [
            Line2D([], [], ls="", marker=KINDS[kind][0], color=KINDS[kind][1], mec="white", label=kind)
            for kind in used
        ]
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(11.6 / WIDTH, 1 - 0.9 / height))
        note = f"Margins above {table['margin'].max():g} are drawn there."
        figure.text(0.1 / WIDTH, 0.2 / height, note, fontsize=SMALL)
