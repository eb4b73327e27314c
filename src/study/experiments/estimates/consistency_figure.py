"""The consistency term <Pi_H lambda, u - g> of (4.16): by cell, in total over H, and as predicted.

For lambda = s_+^alpha and u - g = s_-^gamma, s in side lengths L from a transition, which lies at the
fraction theta of its cell, of length H,

    <Pi_H lambda, u - g> = L (H/L)^{alpha+gamma+1} theta^{gamma+1} (1-theta)^{alpha+1} / (alpha+1)/(gamma+1).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isclose
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from study import scenes as configured
from study import style, tables
from unilateral.errors import InputError
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import ExactSolution
from unilateral.problems.polar_atoms import PolarAtom

FIGURE_HEIGHT_CM = 10.7
TOTAL_MARKER_POINTS = 4.4
PROVED_LOOK: style.Look = {"color": "0.72", "lw": 3.2, "solid_capstyle": "butt"}
MEAN_LOOKS = {"gap_mean": (style.COLOURS[1], "$u-g$"), "lambda_mean": (style.COLOURS[0], r"$\lambda$")}
TERM_TEX = r"\langle\Pi_H\lambda,\,u-g\rangle"


class Transition(NamedTuple):
    """The point where contact begins, t side lengths from the start of a side, and both exponents."""

    side: int
    t: float
    alpha: float
    gamma: float

    @property
    def term_order(self) -> float:
        """The order alpha + gamma + 1 of the consistency term in H."""
        return self.alpha + self.gamma + 1


def first_transition(case: ExactSolution) -> Transition:
    """The transition at the case's harmonic atom. Raises InputError if there is none with a power as gap."""
    for atom in case.atoms:
        if isinstance(atom, PolarAtom) and not atom.is_at_vertex:
            for t, gamma in case.gap_kinks[atom.side]:
                if isclose(t, atom.t, rel_tol=1e-12):
                    return Transition(atom.side, t, float(atom.beta) - 1, float(gamma))
    raise InputError(f"case '{case.name}' has no harmonic atom where its gap closes like a power")


def leading_term(transition: Transition, partition: Partition) -> tuple[float, float]:
    """The term of that transition alone, by the formula of this module, and theta."""
    polygon = partition.polygon
    (side, t, alpha, gamma) = transition
    s = polygon.starts[side] + t * polygon.lengths[side]
    cell = int(np.searchsorted(partition.points, s, side="right")) - 1
    theta = float((s - partition.points[cell]) / partition.lengths[cell])
    size = float(partition.lengths[cell] / polygon.lengths[side])
    # The product of both cell means, over (H/L)^{alpha+gamma}
    means = theta ** (gamma + 1) * (1 - theta) ** (alpha + 1) / ((alpha + 1) * (gamma + 1))
    return float(polygon.lengths[side]) * size**transition.term_order * means, theta


def table(
    errors: Sequence[style.FilePath],
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
    (drawn_case,) = configured.load_cases({**drawn, "cases": [case]})
    (cells,) = configured.scene_partitions({**drawn, "H": [H]})
    row_tables = [_tabulate_side(drawn_case, cells)]
    for scene, scene_errors in zip(scenes, map(tables.load_table, errors), strict=True):
        names = [name for name in cases if name in scene["cases"]]
        for scene_case in configured.load_cases({**scene, "cases": names}):
            row_tables.append(_tabulate_sizes(scene_case, scene_errors.sel(case=scene_case.name)))
    return pd.concat(row_tables)


def _tabulate_side(case: ExactSolution, partition: Partition) -> pd.DataFrame:
    side = first_transition(case).side
    means = cell_means(case, partition)
    on_side = partition.side == side
    start = partition.polygon.starts[side]
    columns = {
        "s": partition.points[:-1] - start,
        "end": partition.points[1:] - start,
        "lambda_mean": means.lambda_means,
        "gap_mean": means.gap_means,
        "term": means.consistency_terms,
    }
    return pd.DataFrame({"kind": "cell", "case": case.name, "H": partition.H, **columns})[on_side]


def _tabulate_sizes(case: ExactSolution, errors: xr.Dataset) -> pd.DataFrame:
    """Three rows for each H, from coarse to fine."""
    transition = first_transition(case)
    H = errors["H"].values
    predicted, theta = zip(
        *(leading_term(transition, make_uniform_partition(case.polygon, size)) for size in H), strict=True
    )
    same = {"case": case.name, "H": H, "theta": theta, "rate": transition.term_order}
    total = errors["consistency"]
    elsewhere = errors["consistency_elsewhere"]
    terms = pd.DataFrame({**same, "total": total, "elsewhere": elsewhere, "predicted": predicted})
    rows = terms.melt([*same], var_name="kind", value_name="term")
    rows = rows.sort_values("H", ascending=False, kind="stable")
    return rows.assign(over_H2=rows["term"] / rows["H"] ** 2)


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Cell by cell, both means and the term that they make; and the totals over H, measured and predicted.

    Columns: kind (cell, total, elsewhere, predicted), case, H, term; of cells s, end, lambda_mean, gap_mean;
    of the others over_H2, theta and rate.
    """
    data = style.read_figure_table(csv_path)
    sorted_data = data.sort_values(["H", "s"])
    cells = sorted_data[sorted_data["kind"] == "cell"]
    rows = sorted_data[sorted_data["kind"] != "cell"]
    with style.open_figure(svg_path, FIGURE_HEIGHT_CM) as figure:
        _draw_means(style.add_axes(figure, 1.7, 5.95, 5.9, 4.0), cells)
        _draw_terms(style.add_axes(figure, 1.7, 1.15, 5.9, 4.2), cells)
        _draw_totals(style.add_axes(figure, 9.7, 4.55, 7.1, 5.4), rows)
        _add_case_key(figure, rows)


def _draw_means(axes: Axes, cells: pd.DataFrame) -> None:
    edges = [*cells["s"], cells["end"].iloc[-1]]
    for column, (colour, name) in MEAN_LOOKS.items():
        axes.stairs(cells[column], edges, fill=True, color=colour, alpha=0.3, lw=0)
        axes.stairs(cells[column], edges, baseline=None, color=colour, lw=1.1, label=name)
    _mark_side(axes, cells)
    case, H = cells[["case", "H"]].iloc[0]
    axes.set_title(f"{case}, $H={style.format_fraction(H)}$: cell by cell")
    axes.set_ylabel("cell means")
    axes.set_ylim(0, 1.22 * cells[list(MEAN_LOOKS)].to_numpy().max())
    axes.legend(loc="upper right", ncols=2, borderaxespad=0.2, handlelength=1.4)
    axes.tick_params(labelbottom=False)


def _draw_terms(axes: Axes, cells: pd.DataFrame) -> None:
    """Draw a marker per cell on a logarithmic scale; those of terms that are 0 stand at its foot."""
    middles = 0.5 * (cells["s"] + cells["end"])
    positive = cells["term"] > 0
    powers = np.floor(np.log10(cells.loc[positive, "term"]))
    ticks = 10.0 ** np.arange(powers.min() - 1, powers.max() + 2)
    axes.set_yscale("log")
    marker: style.Look = {
        "ls": "",
        "marker": "o",
        "ms": TOTAL_MARKER_POINTS,
        "color": style.COLOURS[2],
        "clip_on": False,
    }
    axes.plot(middles[positive], cells.loc[positive, "term"], **marker)
    axes.plot(middles[~positive], np.full((~positive).sum(), ticks[0]), mfc="white", zorder=3, **marker)
    _mark_side(axes, cells)
    axes.set_yticks(ticks, ["$0$", *(f"$10^{{{power:.0f}}}$" for power in np.log10(ticks[1:]))])
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(ticks[0], ticks[-1])
    axes.set_ylabel(r"$H_i\,\times$ both means")
    axes.set_xlabel("$s$ along the side", labelpad=2)


def _mark_side(axes: Axes, cells: pd.DataFrame) -> None:
    """The side's length, and in grey the cells on which the term is not 0."""
    axes.set_xlim(cells["s"].iloc[0], cells["end"].iloc[-1])
    for start, end in cells.loc[cells["term"] > 0, ["s", "end"]].to_numpy():
        axes.axvspan(start, end, color="0.91", lw=0, zorder=0)


def _draw_totals(axes: Axes, rows: pd.DataFrame) -> None:
    """Markers: totals, filled for the first theta; lines: predicted, one for each theta."""
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    cases = list(_sort_by_order(rows)["case"])
    thetas = sorted(rows["theta"].unique())
    for (case, theta, kind), line_rows in rows.groupby(["case", "theta", "kind"]):
        i = cases.index(case)
        k = thetas.index(theta)
        if kind == "predicted":
            line: style.Look = {
                "color": style.COLOURS[i],
                "lw": 0.9,
                "ls": style.LINE_STYLES[k % len(style.LINE_STYLES)],
            }
            axes.plot(line_rows["H"], line_rows["over_H2"], **line)
        if kind == "total":
            axes.plot(
                line_rows["H"],
                line_rows["over_H2"],
                ls="",
                zorder=3,
                **style.marker_look(i, k == 0, TOTAL_MARKER_POINTS),
            )
    sizes = sorted(rows["H"].unique())
    axes.set_xticks(sizes, [f"${style.format_fraction(H)}$" for H in sizes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlabel("cell size $H$")
    axes.set_title(f"${TERM_TEX}\\,/\\,H^2$, all cells")
    style.draw_light_grid(axes)
    axes.plot([0.03, 0.27], [0.41, 0.41], transform=axes.transAxes, **PROVED_LOOK)
    axes.text(
        0.03, 0.43, "slope of $H^2$, proved", transform=axes.transAxes, fontsize=style.SMALL_FONT_POINTS
    )


def _sort_by_order(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.drop_duplicates("case").sort_values("rate")


def _add_case_key(figure: Figure, rows: pd.DataFrame) -> None:
    """The cases with their predicted powers of H, what is proved, and what other cells add."""
    cases = _sort_by_order(rows)
    handles = [
        style.legend_entry(
            rf"{case}: $H^{{{rate:g}}}$", lw=0.9, **style.marker_look(i, True, TOTAL_MARKER_POINTS)
        )
        for i, (case, rate) in enumerate(zip(cases["case"], cases["rate"], strict=True))
    ]
    titled: style.Look = {"title": r"predicted, $H^{\alpha+\gamma+1}$:", "alignment": "left"}
    style.add_legend(figure, handles, 8.9, 3.45, ncols=2, columnspacing=1.4, **titled)
    largest = rows.loc[rows["kind"] == "elsewhere", "term"].max()
    note = "Markers: computed; lines: predicted. Filled and open markers:\n"
    note += "levels that differ in the place of the transition in its cell.\n"
    note += f"On cells without a transition the term is {largest:g}, in all cases."
    style.add_note(figure, note, 8.9, linespacing=1.4)
