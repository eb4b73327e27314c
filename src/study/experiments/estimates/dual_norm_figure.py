"""The two-sided norm ||.||_{-1/2}: errors between their bounds, the bounds' gap, and what a shortcut says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study import style, tables
from study.scenes import dual_norm_partitions, scene_partitions
from unilateral.formulas.formula import parse_real
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Gram

FUNCTION_TITLES = {"one": r"$\mu=1$", "alternating": r"$\mu=\pm 1$, cell by cell"}
COLUMNS = ["kind", "case", "h", "H", "h_over_H", "lower", "upper", "mean", "gap", "shortcut"]
N_COMPARED_CASES = 2
DASH_LINE_WIDTHS = 2.6
BOUNDS_NOTE = (
    "Markers: r.m.s. means of the two bounds, with bars from one to the other; the shortcuts of "
    r"$\mu=1$ and $\mu=\pm1$ are one line."
)


def table(
    errors: style.FilePath, norm: style.FilePath, scene: Mapping[str, Any], h_over_H: object
) -> pd.DataFrame:
    """||.||_{-1/2} with its bounds and the shortcut H^{1/2} ||.||_0: errors at one h/H, mu = 1, mu = +-1.

    `norm` holds the forms of the dual norm on the scene's partitions. Errors that are 0 are left out.
    """
    gram = Gram.from_table(tables.load_table(norm))
    partitions = scene_partitions(scene)
    runs = tables.select_ratio(tables.load_table(errors), parse_real(h_over_H, "h_over_H"))
    bounds = {bound: tables.error_in_norm(runs, "hm12", bound) for bound in ("lower", "upper")}
    norms = xr.Dataset({**bounds, "l2": tables.error_in_norm(runs, "l2"), "u_norm": runs["u_norm"]})
    run_errors = norms.to_dataframe(["case", "run"]).reset_index().assign(kind="error")
    nonzero = run_errors[run_errors["upper"] > tables.ZERO_ERROR_SHARE * run_errors["u_norm"]]
    rows = pd.concat(
        [nonzero, *(_tabulate_functions(gram, partitions[k]) for k in dual_norm_partitions(scene))]
    )
    lower = rows["lower"]
    upper = rows["upper"]
    l2 = rows["l2"]
    mean = np.sqrt(0.5 * (lower**2 + upper**2))
    shortcut = np.sqrt(rows["H"]) * l2
    return rows.assign(mean=mean, gap=upper / lower - 1, shortcut=shortcut)[COLUMNS]


def _tabulate_functions(gram: Gram, partition: Partition) -> pd.DataFrame:
    """Rows of mu = 1 and of mu = +-1, in turn from cell to cell."""
    m = partition.n_cells
    p0 = gram.coarsen(partition).p0
    rows = []
    for kind, mu in zip(FUNCTION_TITLES, (np.ones(m), (-1.0) ** np.arange(m)), strict=True):
        # Both Gram matrices of P0: mu.G mu bounds ||mu||_{-1/2}^2 from either side
        lower = np.sqrt(mu @ p0.lower @ mu)
        upper = np.sqrt(mu @ p0.upper @ mu)
        l2 = np.sqrt(partition.lengths @ mu**2)
        rows.append({"kind": kind, "case": "", "H": partition.H, "lower": lower, "upper": upper, "l2": l2})
    return pd.DataFrame(rows)


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Over H: errors of lambda_H, the relative gap between their bounds, and ||.||_{-1/2} by the shortcut.

    Columns: kind (error, one, alternating), case, h and h_over_H (of errors), H, lower, upper, mean (of the
    bounds), gap (upper/lower - 1), shortcut (H^{1/2} ||.||_0). The shortcut is drawn for both functions and
    the first two cases.
    """
    data = style.read_figure_table(csv_path)
    line_names = data["case"].where(data["kind"] == "error", data["kind"])
    lines = {str(line): rows.sort_values("H") for line, rows in data.groupby(line_names, sort=False)}
    cases = [line for line in lines if line not in FUNCTION_TITLES]
    looks = _choose_looks(cases)
    with style.open_figure(svg_path, 9.0) as figure:
        errors, gaps, norms = [
            style.add_axes(figure, left_cm, 2.9, 4.4, 5.2) for left_cm in (1.25, 7.05, 12.45)
        ]
        for line, look in looks.items():
            rows = lines[line]
            if line in cases:
                errors.plot(rows["H"], rows["mean"], **look)
                errors.vlines(rows["H"], rows["lower"], rows["upper"], color=look["color"], lw=3)
            gaps.plot(rows["H"], rows["gap"], **look)
            if line in (*FUNCTION_TITLES, *cases[:N_COMPARED_CASES]):
                _draw_norm_and_shortcut(norms, rows, look, _shortcut_dashes(line))
        ratios = ", ".join(map(style.format_fraction, sorted(data["h_over_H"].dropna().unique())))
        errors.set(title=style.NORM_TITLES["hm12"], xlabel=f"cell size $H$  ($h/H={ratios}$)")
        gaps.set(title="upper / lower bound $-$ 1", xlabel="cell size $H$")
        norms.set(title=r"$\Vert\mu\Vert_{-1/2}$ and $H^{1/2}\Vert\mu\Vert_0$", xlabel="cell size $H$")
        for axes in (errors, gaps, norms):
            style.set_size_axes(axes, data["H"])
        gaps.yaxis.set_major_formatter(lambda gap, _: f"{100 * gap:g} %")
        _add_norm_keys(figure, looks)
        style.add_note(figure, BOUNDS_NOTE)


def _choose_looks(cases: list[str]) -> dict[str, style.Look]:
    """The looks of the lines of the cases, and then of the functions."""
    # the functions take what the familiar cases leave
    numbers = style.number_looks([*FUNCTION_TITLES, *cases])
    return {
        line: {**style.numbered_look(numbers[line]), "ms": 4.6, "lw": 1.1}
        for line in [*cases, *FUNCTION_TITLES]
    }


def _draw_norm_and_shortcut(
    axes: Axes, rows: pd.DataFrame, look: style.Look, dashes: tuple[float, tuple[float, float]]
) -> None:
    """Draw ||.||_{-1/2} over H, and the shortcut for it dashed in the same colour."""
    dashed: style.Look = {"marker": "", "ls": dashes}
    axes.plot(rows["H"], rows["mean"], **look)
    axes.plot(rows["H"], rows["shortcut"], **(look | dashed))


def _add_norm_keys(figure: Figure, looks: Mapping[str, style.Look]) -> None:
    """Add the key of cases and functions, and that of the norm and its shortcut."""
    handles = [style.legend_entry(FUNCTION_TITLES.get(line, line), **look) for line, look in looks.items()]
    grey: style.Look = {"color": "0.25", "lw": 1.1}
    norm = style.legend_entry(r"$\Vert\mu\Vert_{-1/2}$", **grey)
    shortcut = r"the shortcut $H^{1/2}\Vert\mu\Vert_0$"
    short = style.legend_entry(shortcut, ls=_shortcut_dashes("one"), **grey)
    padded: style.Look = {"borderpad": None, "borderaxespad": None}
    style.add_legend(figure, handles, 0.0, 1.75, ncols=3, **padded)
    style.add_legend(figure, [norm, short], 12, 1.75, **padded)


def _shortcut_dashes(function: str) -> tuple[float, tuple[float, float]]:
    """The shortcuts of both functions coincide: the dashes of one fill the gaps of the other."""
    return DASH_LINE_WIDTHS * (function == "alternating"), (DASH_LINE_WIDTHS, DASH_LINE_WIDTHS)
