"""The consistency term of (4.16): on the cells of one side, and in total over H."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from unilateral.geometry.partition import Partition, uniform
from unilateral.norms.exact import cell_means
from unilateral.problems.case import Case
from unilateral.study import tables
from unilateral.study.figures.style import (
    COLOURS,
    LINES,
    MARKERS,
    SMALL,
    WIDTH,
    FilePath,
    as_fraction,
    axes_at,
    figure_in,
    light_grid,
    read,
)
from unilateral.study.runs.consistency import first_transition, leading
from unilateral.study.scenes import cases as problems
from unilateral.study.scenes import partitions

KINDS = ("cell", "total", "elsewhere", "predicted")
HEIGHT = 10.7
PROVED: dict[str, Any] = {"color": "0.72", "lw": 3.2, "solid_capstyle": "butt"}
MEANS = {"gap_mean": (COLOURS[1], "$u-g$"), "lambda_mean": (COLOURS[0], r"$\lambda$")}
TERM = r"\langle\Pi_H\lambda,\,u-g\rangle"


def table(
    errors: Sequence[FilePath],
    scenes: Sequence[Mapping[str, Any]],
    case: str,
    H: object,
    cases: Sequence[str],
) -> pd.DataFrame:
    """The cells of the side with the transition of `case`; and, over H, totals beside what is predicted.

    `errors` are the tables of the scenes, which have the cases. The kind `elsewhere` is the part of a total
    that cells without a transition add; all terms stand in one column, so that they are rounded alike.
    """
    drawn = next(scene for scene in scenes if case in scene["cases"])
    (of_cells,) = problems({**drawn, "cases": [case]})
    (cells,) = partitions({**drawn, "H": [H]})
    rows = []
    for scene, found in zip(scenes, map(tables.load, errors), strict=True):
        for each in problems({**scene, "cases": [name for name in cases if name in scene["cases"]]}):
            rows += _of_sizes(each, found.sel(case=each.name))
    return pd.concat([_of_side(of_cells, cells), pd.DataFrame(rows)])


def _of_side(case: Case, partition: Partition) -> pd.DataFrame:
    side, found = first_transition(case).side, cell_means(case, partition)
    here, start = partition.side == side, partition.polygon.starts[side]
    return pd.DataFrame(
        {
            "kind": "cell",
            "case": case.name,
            "H": partition.H,
            "s": partition.points[:-1][here] - start,
            "end": partition.points[1:][here] - start,
            "lambda_mean": found.lambda_means[here],
            "gap_mean": found.gap_means[here],
            "term": found.consistency_terms[here],
        }
    )


def _of_sizes(case: Case, errors: xr.Dataset) -> list[dict[str, object]]:
    transition, rows = first_transition(case), []
    for k, H in enumerate(errors["H"].values):
        predicted, theta = leading(transition, uniform(case.polygon, H))
        terms = {
            "total": float(errors["consistency"][k]),
            "elsewhere": float(errors["consistency_elsewhere"][k]),
            "predicted": predicted,
        }
        same = {"case": case.name, "H": float(H), "theta": theta, "rate": transition.rate}
        rows += [{"kind": kind, **same, "term": term, "over_H2": term / H**2} for kind, term in terms.items()]
    return rows


def draw(csv_path: FilePath, svg_path: FilePath) -> None:
    """Cell by cell, both means and the term that they make; and the totals over H, measured and predicted.

    Columns: kind (cell, total, elsewhere, predicted), case, H, term; of cells s, end, lambda_mean, gap_mean;
    of the others over_H2, theta and rate.
    """
    data = read(csv_path)
    cells, rows = (part.sort_values(["H", "s"]) for _, part in data.groupby(data["kind"] != "cell"))
    with figure_in(svg_path, HEIGHT) as figure:
        _means(axes_at(figure, 1.7, 5.95, 5.9, 4.0), cells)
        _terms(axes_at(figure, 1.7, 1.15, 5.9, 4.2), cells)
        _totals(axes_at(figure, 9.7, 4.55, 7.1, 5.4), rows)
        _key(figure, rows)


def _means(axes: Axes, cells: pd.DataFrame) -> None:
    edges = [*cells["s"], cells["end"].iloc[-1]]
    for column, (colour, name) in MEANS.items():
        axes.stairs(cells[column], edges, fill=True, color=colour, alpha=0.3, lw=0)
        axes.stairs(cells[column], edges, baseline=None, color=colour, lw=1.1, label=name)
    _side(axes, cells)
    axes.set_title(f"{cells['case'].iloc[0]}, $H={as_fraction(float(cells['H'].iloc[0]))}$: cell by cell")
    axes.set_ylabel("cell means")
    axes.set_ylim(0, 1.22 * cells[list(MEANS)].to_numpy().max())
    axes.legend(loc="upper right", ncols=2, borderaxespad=0.2, handlelength=1.4)
    axes.tick_params(labelbottom=False)


def _terms(axes: Axes, cells: pd.DataFrame) -> None:
    """A marker per cell on a logarithmic scale, at whose foot stand those that are 0."""
    middles, positive = 0.5 * (cells["s"] + cells["end"]), cells["term"] > 0
    powers = np.floor(np.log10(cells.loc[positive, "term"]))
    ticks = 10.0 ** np.arange(powers.min() - 1, powers.max() + 2)
    axes.set_yscale("log")
    marker: dict[str, Any] = {"ls": "", "marker": "o", "ms": 4.4, "color": COLOURS[2], "clip_on": False}
    axes.plot(middles[positive], cells.loc[positive, "term"], **marker)
    axes.plot(middles[~positive], np.full((~positive).sum(), ticks[0]), mfc="white", zorder=3, **marker)
    _side(axes, cells)
    axes.set_yticks(ticks, ["$0$", *(f"$10^{{{power:.0f}}}$" for power in np.log10(ticks[1:]))])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(ticks[0], ticks[-1])
    axes.set_ylabel(r"$H_i\,\times$ both means")
    axes.set_xlabel("$s$ along the side", labelpad=2)


def _side(axes: Axes, cells: pd.DataFrame) -> None:
    """The side's length, and in grey the cells on which the term is not 0."""
    axes.set_xlim(cells["s"].iloc[0], cells["end"].iloc[-1])
    for start, end in cells.loc[cells["term"] > 0, ["s", "end"]].to_numpy():
        axes.axvspan(start, end, color="0.91", lw=0, zorder=0)


def _totals(axes: Axes, rows: pd.DataFrame) -> None:
    """Markers: totals, filled for the first theta; lines: predicted, one for each theta."""
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    cases, thetas = list(_by_rate(rows)["case"]), sorted(rows["theta"].unique())
    for (case, theta, kind), part in rows.groupby(["case", "theta", "kind"]):
        i, k = cases.index(case), thetas.index(theta)
        if kind == "predicted":
            axes.plot(part["H"], part["over_H2"], color=COLOURS[i], lw=0.9, ls=LINES[k % len(LINES)])
        if kind == "total":
            axes.plot(part["H"], part["over_H2"], ls="", zorder=3, **_look(i, k == 0))
    sizes = sorted(rows["H"].unique())
    axes.set_xticks(sizes, [f"${as_fraction(H)}$" for H in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("cell size $H$")
    axes.set_title(f"${TERM}\\,/\\,H^2$, all cells")
    light_grid(axes)
    axes.plot([0.03, 0.27], [0.41, 0.41], transform=axes.transAxes, **PROVED)
    axes.text(0.03, 0.43, "slope of $H^2$, proved", transform=axes.transAxes, fontsize=SMALL)


def _by_rate(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.drop_duplicates("case").sort_values("rate")


def _look(i: int, filled: bool) -> dict[str, Any]:
    face = COLOURS[i] if filled else "white"
    return {"marker": MARKERS[i], "ms": 4.4, "color": COLOURS[i], "mfc": face, "mew": 1.0}


def _key(figure: Figure, rows: pd.DataFrame) -> None:
    """The cases with their predicted powers of H, what is proved, and what other cells add."""
    cases = _by_rate(rows)
    handles = [
        Line2D([], [], lw=0.9, label=rf"{case}: $H^{{{rate:g}}}$", **_look(i, True))
        for i, (case, rate) in enumerate(zip(cases["case"], cases["rate"], strict=True))
    ]
    figure.legend(
        handles=handles,
        title=r"predicted, $H^{\alpha+\gamma+1}$:",
        alignment="left",
        loc="upper left",
        bbox_to_anchor=(8.9 / WIDTH, 3.45 / HEIGHT),
        ncols=2,
        borderpad=0,
        borderaxespad=0,
        columnspacing=1.4,
    )
    largest = rows.loc[rows["kind"] == "elsewhere", "term"].max()
    note = "Markers: computed; lines: predicted. Filled and open markers:\n"
    note += "levels that differ in the place of the transition in its cell.\n"
    note += f"On cells without a transition the term is {largest:g}, in all cases."
    figure.text(8.9 / WIDTH, 0.2 / HEIGHT, note, fontsize=SMALL, linespacing=1.4)
