"""Error against work, and what is behind it: the growth of the steps, the price of a step, when to stop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from study import style, tables
from study.experiments.cost import trade as cost
from unilateral.formulas.formula import parse_real

COLUMNS = (
    *("kind", "norm", "label", "H_over_h", "h", "H", "unknowns", "stop"),
    *("work", "error", "steps", "slope", "excess"),
)
UNFITTED_ALGORITHMS = ("barzilai_borwein", "newton")
"""Algorithms whose steps follow no power of H: they change with rounding, or are few."""
ALGORITHM_LOOKS: dict[str, tuple[str, style.Look]] = {
    "uzawa": (r"Uzawa, $\rho=1.9/\lambda_{\max}(S)$", {"color": style.COLOURS[0], "marker": "o", "ms": 5.2}),
    "safe": (r"Uzawa, safe: $\rho=1.9\,\sigma_1$", {"color": style.COLOURS[6], "marker": "P", "ms": 3.4}),
    "optimal": (
        r"Uzawa, $\rho=2/(\lambda_{\min}+\lambda_{\max})$",
        {"color": style.COLOURS[4], "marker": "x", "ms": 2.6},
    ),
    "nesterov": ("Nesterov, restarted", {**style.numbered_look(1), "ms": 3.2}),
    "barzilai_borwein": ("projected Barzilai–Borwein", {**style.numbered_look(2), "ms": 3.8}),
    "newton": ("primal–dual active set", {**style.numbered_look(3), "ms": 3.0}),
}
SETUP_LOOK: style.Look = {"marker": "", "ls": (0, (3, 2))}
MATRIX_LOOKS: dict[str, tuple[str, style.Look]] = {
    "A": ("solve with $A$", style.numbered_look(0)),
    "A_3": ("solve with $A_3$", style.numbered_look(1)),
    "S": ("multiply by $S$", style.numbered_look(2)),
    "setup_A": ("set-up, with $A$", style.numbered_look(0) | SETUP_LOOK),
    "setup_S": ("set-up, with $S$", style.numbered_look(2) | SETUP_LOOK),
}
PANEL_LEFTS_CM = (1.35, 6.95, 12.55)
PANEL_WIDTH_CM = 4.25
PANEL_HEIGHT_CM = 4.3
THIN_LINE: style.Look = {"lw": 0.9, "ms": 3.6}
FRONT_LOOK: style.Look = {"color": "0.75", "lw": 3.0, "marker": "", "solid_joinstyle": "round"}
MIN_DRAWN_LEVEL = 1e-5
"""Levels below this one are not drawn: all errors are then those of the discrete solution."""


def table(
    crossed: style.FilePath,
    cases: style.FilePath,
    algebra: style.FilePath,
    base: Mapping[str, Any],
    coarsest: object,
) -> pd.DataFrame:
    """Work, in operations, and relative errors, and what is behind them.

    kind front: work and relative error in a norm that no cheaper run beats; line: those of the cheapest
    algorithm at a fixed H/h and the level that is enough; steps: of an algorithm to the level 1e-6, with
    the exponent fitted up to the `coarsest` H; step: work of one, or of the set-up, by matrix; stop: the
    largest excess at a level.
    """
    runs = tables.load_table(crossed)
    case_runs = tables.load_table(cases)
    matrix_costs = tables.load_table(algebra)
    ratio = parse_real(base["H_over_h"], "H_over_h")
    largest = parse_real(coarsest, "coarsest")
    tables_by_kind = [_tabulate_norm(runs, case_runs, norm, largest) for norm in style.NORM_TITLES]
    tables_by_kind += [_tabulate_steps(runs, ratio, largest), _tabulate_matrices(matrix_costs)]
    return pd.concat(tables_by_kind, ignore_index=True)[list(COLUMNS)]


def _tabulate_norm(crossed: xr.Dataset, cases: xr.Dataset, norm: str, coarsest: float) -> pd.DataFrame:
    cheapest = cost.cheapest_at_level(
        crossed, norm, cost.sufficient_stop(cases.isel(case=[0]), norm, coarsest)
    )
    lines = cheapest.to_dataframe().reset_index().dropna()
    worst = cost.error_excess(cases.sel(H=cases["H"] <= coarsest), norm).max(["case", "H_over_h", "H"])
    stops = pd.DataFrame({"kind": "stop", "stop": worst["stop"], "excess": worst})
    return pd.concat([tabulate_front(crossed, norm), lines.assign(kind="line"), stops]).assign(norm=norm)


def tabulate_front(crossed: xr.Dataset, norm: str) -> pd.DataFrame:
    """The runs that no cheaper one beats in a norm."""
    crossed = crossed.sel(stop=crossed["stop"] < 1)
    columns = {"error": cost.relative_errors(crossed, norm), "work": crossed["operations"], "h": crossed["h"]}
    points = xr.Dataset(columns).to_dataframe().reset_index().rename(columns={"algorithm": "label"})
    front = points.iloc[cost.pareto_front(points["work"].to_numpy(), points["error"].to_numpy())]
    return front.assign(kind="front")


def _tabulate_steps(crossed: xr.Dataset, H_over_h: float, coarsest: float) -> pd.DataFrame:
    algorithm_rows = []
    for algorithm in crossed["algorithm"].values:
        steps = crossed["steps"].sel(H_over_h=H_over_h, algorithm=algorithm)
        last = steps.sel(stop=cost.COMPARED_LEVEL, method="nearest")
        fitted = algorithm not in UNFITTED_ALGORITHMS
        slope = round(cost.growth_exponent(crossed, algorithm, H_over_h, coarsest), 1) if fitted else np.nan
        # Two digits where rounding decides the last one
        counts = last.values if fitted else [float(f"{count:.2g}") for count in last.values]
        line = {"kind": "steps", "label": algorithm, "H": last["H"], "steps": counts, "slope": slope}
        algorithm_rows.append(pd.DataFrame(line))
    return pd.concat(algorithm_rows)


def _tabulate_matrices(algebra: xr.Dataset) -> pd.DataFrame:
    lines = {name: algebra["step_operations"].sel(algebra=name) for name in algebra["algebra"].values}
    lines |= {f"setup_{name}": algebra["setup_operations"].sel(algebra=name) for name in ("S", "A")}
    unknowns = algebra["unknowns"].sel(algebra="S")
    line_tables = [
        pd.DataFrame({"kind": "step", "label": label, "unknowns": unknowns, "work": values})
        for label, values in lines.items()
    ]
    return pd.concat(line_tables)


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Above: relative errors over work at fixed H/h, and the front of all. Below: steps, one step, stops.

    Columns: kind (front, line, steps, step, stop), norm, label (algorithm or matrix), H_over_h, H, unknowns,
    stop, work, error, steps, slope (p of steps ~ H^-p), excess. Raises InputError for a table without them.
    """
    data = style.read_figure_table(csv_path)
    by_kind = {kind: rows for kind, rows in data.groupby("kind")}
    looks = _choose_line_looks(by_kind["line"])
    with style.open_figure(svg_path, 14.8) as figure:
        for left_cm, (norm, title) in zip(PANEL_LEFTS_CM, style.NORM_TITLES.items(), strict=True):
            axes = style.add_axes(figure, left_cm, 9.4, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            front = by_kind["front"][by_kind["front"]["norm"] == norm]
            lines = by_kind["line"][by_kind["line"]["norm"] == norm]
            _draw_errors_over_work(axes, front, lines, looks)
            axes.set(title=f"{title}, relative", xlabel="operations")
        steps, matrices, stops = [
            style.add_axes(figure, left_cm, 2.4, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            for left_cm in PANEL_LEFTS_CM
        ]
        _draw_steps(steps, by_kind["steps"])
        _draw_matrices(matrices, by_kind["step"])
        _draw_stops(stops, by_kind["stop"])
        _add_run_keys(figure, looks)


def _choose_line_looks(lines: pd.DataFrame) -> dict[float, style.Look]:
    """The look of the line of each H/h."""
    marker_edge: style.Look = {"mec": "white", "mew": 0.3}
    ratios = np.unique(lines["H_over_h"]).tolist()
    return {ratio: {**style.numbered_look(i), **THIN_LINE, **marker_edge} for i, ratio in enumerate(ratios)}


def _draw_errors_over_work(
    axes: Axes, front: pd.DataFrame, lines: pd.DataFrame, looks: Mapping[float, style.Look]
) -> None:
    """Draw the front of all runs, and a line for each H/h."""
    style.draw_log_line(axes, front["work"], front["error"], **FRONT_LOOK)
    for ratio, rows in lines.groupby("H_over_h"):
        style.draw_log_line(axes, rows["work"], rows["error"], **looks[ratio])
    style.set_plain_ticks(axes.yaxis)


def _draw_matrices(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the operations of a step and of the set-up over the unknowns, by matrix."""
    for label, (name, look) in MATRIX_LOOKS.items():
        line = rows[rows["label"] == label]
        style.draw_log_line(axes, line["unknowns"], line["work"], **{**look, **THIN_LINE}, label=name)
    axes.set(title="operations: a step, the set-up", xlabel="unknowns in $\\Omega$")
    axes.set_ylim(top=200 * axes.get_ylim()[1])
    _add_line_names(axes, "upper left")


def _draw_stops(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the error at a stopping level over that of the discrete solution, by norm."""
    drawn = rows[rows["stop"] >= MIN_DRAWN_LEVEL]
    for i, (norm, title) in enumerate(style.NORM_TITLES.items()):
        line = drawn[drawn["norm"] == norm]
        look = style.numbered_look(i) | THIN_LINE
        style.draw_log_line(axes, line["stop"], line["excess"], **look, label=title)
    axes.invert_xaxis()
    _add_line_names(axes, "upper right")
    axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    axes.set(title=r"error, over that of $(u_h,\lambda_H)$", xlabel="stopping level")


def _add_run_keys(figure: Figure, looks: Mapping[float, style.Look]) -> None:
    """Add the key of the upper panels below these, and that of the algorithms at the foot."""
    fronts = [
        style.legend_entry(f"$H/h={style.format_fraction(ratio)}$", **look) for ratio, look in looks.items()
    ]
    fronts.append(style.legend_entry("front of all runs", **FRONT_LOOK))
    algorithms = [style.legend_entry(name, lw=0.9, **look) for name, look in ALGORITHM_LOOKS.values()]
    space: style.Look = {"labelspacing": 0.4, "columnspacing": 1.15, "handlelength": 1.6}
    style.add_legend(figure, fronts, 1.35, 8.2, ncols=7, **space)
    style.add_legend(figure, algorithms, 1.35, 1.25, ncols=3, **space)


def _draw_steps(axes: Axes, rows: pd.DataFrame) -> None:
    """Draw the steps over H, and fitted exponents beside the finest points; one where lines coincide."""
    ends: list[float] = []
    place: style.Look = {"xytext": (5, 0), "textcoords": "offset points", "va": "center"}
    for label, line in rows.groupby("label", sort=False):
        look = {**ALGORITHM_LOOKS[str(label)][1], "lw": 0.9}
        style.draw_log_line(axes, line["H"], line["steps"], **look)
        end = line.loc[line["H"].idxmin()]
        if pd.notna(end["slope"]) and all(not 0.8 < end["steps"] / end_steps < 1.25 for end_steps in ends):
            text = f"$H^{{-{end['slope']:.1f}}}$"
            axes.annotate(
                text, (end["H"], end["steps"]), color=look["color"], fontsize=style.SMALL_FONT_POINTS, **place
            )
            ends.append(end["steps"])
    sizes = sorted(rows["H"].unique(), reverse=True)
    axes.set_xlim(1.3 * sizes[0], sizes[-1] / 5.0)
    axes.set_xticks(sizes[::2], [style.format_fraction(H) for H in sizes[::2]])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set(title=r"steps to the level $10^{-6}$", xlabel="$H$")


def _add_line_names(axes: Axes, corner: Any) -> None:
    """The lines' names in a corner, and no minor ticks."""
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())
    space: style.Look = {"borderpad": 0, "borderaxespad": 0.4, "labelspacing": 0.25, "handlelength": 1.6}
    axes.legend(loc=corner, **space)
