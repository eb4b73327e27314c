"""The two-sided norm ||.||_{-1/2}: errors between their bounds, the bounds' gap, and what a shortcut says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from unilateral.study.figures.rates import FAMILIAR, MARKERS
from unilateral.study.figures.style import (
    COLOURS,
    NORMS,
    SMALL,
    WIDTH,
    FilePath,
    as_fraction,
    axes_at,
    figure_in,
    read,
)

DUAL_NORM_COLUMNS = (
    "kind",
    "case",
    "h",
    "H",
    "h_over_H",
    "lower",
    "upper",
    "mean",
    "gap",
    "shortcut",
)
FUNCTIONS = {"one": r"$\mu=1$", "alternating": r"$\mu=\pm 1$, cell by cell"}
KINDS = ("error", *FUNCTIONS)
COMPARED = 2
DASH = 2.6
NOTE = (
    "Markers: r.m.s. means of the guaranteed bounds, with bars from one to the other; the shortcuts of "
    r"$\mu=1$ and $\mu=\pm1$ are one line."
)


def dual_norm(csv_path: FilePath, svg_path: FilePath) -> None:
    """Over H: errors of lambda_H, the relative gap between their bounds, and ||.||_{-1/2} by the shortcut.

    Columns: kind (error, one, alternating), case, h and h_over_H (of errors), H, lower, upper, mean (of the
    bounds), gap (upper/lower - 1), shortcut (H^{1/2} ||.||_0). The shortcut is drawn for both functions and
    the first two cases. Raises InputError for a table without them.
    """
    table = read(csv_path, DUAL_NORM_COLUMNS, {"kind": KINDS})
    name = table["case"].where(table["kind"] == "error", table["kind"])
    lines = {str(of): rows.sort_values("H") for of, rows in table.groupby(name, sort=False)}
    lines = {of: lines[of] for of in sorted(lines, key=lambda of: of in FUNCTIONS)}
    cases = [of for of in lines if of not in FUNCTIONS]
    with figure_in(svg_path, 9.0) as figure:
        errors, gaps, norms = (axes_at(figure, left, 2.9, 4.4, 5.2) for left in (1.25, 7.05, 12.45))
        for of, rows in lines.items():
            look = _look(of, list(lines))
            if of in cases:
                errors.plot(rows["H"], rows["mean"], **look)
                errors.vlines(rows["H"], rows["lower"], rows["upper"], color=look["color"], lw=3)
            gaps.plot(rows["H"], rows["gap"], **look)
            if of in (*FUNCTIONS, *cases[:COMPARED]):
                norms.plot(rows["H"], rows["mean"], **look)
                norms.plot(rows["H"], rows["shortcut"], **{**look, "marker": "", "ls": _dashes(of)})
        ratios = ", ".join(map(as_fraction, sorted(table["h_over_H"].dropna().unique())))
        errors.set(title=NORMS["hm12"], xlabel=f"cell size $H$  ($h/H={ratios}$)")
        gaps.set(title="upper / lower bound $-$ 1", xlabel="cell size $H$")
        norms.set(title=r"$\Vert\mu\Vert_{-1/2}$ and $H^{1/2}\Vert\mu\Vert_0$", xlabel="cell size $H$")
        for axes in (errors, gaps, norms):
            _sizes(axes, table["H"])
        gaps.yaxis.set_major_formatter(lambda gap, _: f"{100 * gap:g} %")
        _key(figure, list(lines))


def _look(of: str, names: list[str]) -> dict[str, Any]:
    """Cases look as in all figures; the functions take what the cases leave."""
    i = list(dict.fromkeys((*FAMILIAR, *FUNCTIONS, *names))).index(of)
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "ms": 4.6, "lw": 1.1}


def _dashes(of: str) -> tuple[float, tuple[float, float]]:
    """The shortcuts of both functions coincide: the dashes of one fill the gaps of the other."""
    return DASH * (of == "alternating"), (DASH, DASH)


def _sizes(axes: Axes, H: pd.Series) -> None:
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    powers = range(int(np.floor(np.log2(H.min()))), 1)
    axes.set_xticks([2.0**k for k in powers], [f"${as_fraction(2.0**k)}$" for k in powers])
    axes.set_xlim(H.min() / 1.3, H.max() * 1.3)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=20))
    axes.grid(which="major", color="0.9", lw=0.5)
    axes.set_axisbelow(True)


def _key(figure: Figure, names: list[str]) -> None:
    labels = [FUNCTIONS.get(of, of) for of in names]
    handles = [
        Line2D([], [], label=label, **_look(of, names)) for of, label in zip(names, labels, strict=True)
    ]
    true = Line2D([], [], color="0.25", lw=1.1, label=r"$\Vert\mu\Vert_{-1/2}$")
    short = Line2D(
        [], [], color="0.25", lw=1.1, ls=_dashes("one"), label=r"the shortcut $H^{1/2}\Vert\mu\Vert_0$"
    )
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.75 / 9), ncols=3)
    figure.legend(handles=[true, short], loc="upper left", bbox_to_anchor=(12 / WIDTH, 1.75 / 9))
    figure.text(0.1 / WIDTH, 0.2 / 9, NOTE, fontsize=SMALL)
