"""The multipliers that the mesh sees worst, along the boundary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from study import style, tables
from unilateral.errors import InputError
from unilateral.formulas.formula import parse_real

PANEL_HEIGHT_CM = 2.15
STRIP_GAP_CM = 0.45
STRIP_LEFT_CM = 1.25
PANEL_BOTTOM_CM = 1.1


def table(survey: style.FilePath, h_over_H: Sequence[object]) -> pd.DataFrame:
    """One row per h/H and cell of the survey's first partition: the worst multiplier on it.

    Raises InputError for a ratio that the survey does not have.
    """
    first_partition = tables.load_table(survey).isel(partition=0)
    return pd.concat([_tabulate_worst(first_partition, parse_real(ratio, "h_over_H")) for ratio in h_over_H])


def _tabulate_worst(survey: xr.Dataset, ratio: float) -> pd.DataFrame:
    same = np.flatnonzero(np.isclose(survey["h_over_H"].values, ratio, rtol=1e-9))
    if not same.size:
        raise InputError(f"survey '{survey.attrs['scene']}' has no mesh with h/H = {ratio:g} to draw")
    mesh = survey.isel(mesh=int(same[0]))
    points = survey["points"].values
    points = points[np.isfinite(points)]
    m = len(points) - 1
    beta = 0.5 * (mesh["beta_lower"] + mesh["beta_upper"])
    cells = {"side": survey["side"].values[:m].astype(int), "s": points[:-1], "end": points[1:]}
    mesh_columns = {"h_over_H": float(mesh["h_over_H"]), "beta": float(beta)}
    return pd.DataFrame({**mesh_columns, **cells, "mu": mesh["worst"].values[:m]})


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """The worst mu in P0(T_H) over arc length, a strip for each h/H, with its beta.

    Columns: h_over_H, beta, side, and for each cell, from s to end, mu (largest absolute value 1).
    """
    strips = [rows.sort_values("s") for _, rows in style.read_figure_table(csv_path).groupby("h_over_H")]
    with style.open_figure(
        svg_path, PANEL_BOTTOM_CM + len(strips) * (PANEL_HEIGHT_CM + STRIP_GAP_CM) + 0.15
    ) as figure:
        for i, rows in enumerate(strips):
            bottom = PANEL_BOTTOM_CM + i * (PANEL_HEIGHT_CM + STRIP_GAP_CM)
            width = style.PAGE_WIDTH_CM - STRIP_LEFT_CM - 2.3
            axes = style.add_axes(figure, STRIP_LEFT_CM, bottom, width, PANEL_HEIGHT_CM)
            _draw_worst(axes, rows)
            ends = rows.groupby("side").agg(start=("s", "min"), end=("end", "max"))
            names = [f"side {side}" for side in ends.index] if i == len(strips) - 1 else ()
            style.draw_sides(axes, ends, names, 1.06, color="black", lw=1.0)
            axes.tick_params(labelbottom=i == 0)
            if i == 0:
                axes.set_xlabel(r"arc length $s$ along $\partial\Omega$")


def _draw_worst(axes: Axes, rows: pd.DataFrame) -> None:
    edges = [*rows["s"], rows["end"].iloc[-1]]
    for sign, colour in ((1, style.COLOURS[0]), (-1, style.COLOURS[1])):
        signed_values = (sign * rows["mu"]).clip(lower=0) * sign
        axes.stairs(signed_values, edges, fill=True, color=colour, alpha=0.35, lw=0)
    axes.stairs(rows["mu"], edges, baseline=None, color="black", lw=0.9)
    axes.axhline(0, color="0.4", lw=0.5)
    axes.set(xlim=(edges[0], edges[-1]), ylim=(-1.15, 1.15), yticks=(-1, 0, 1), ylabel=r"$\mu$")
    axes.yaxis.set_label_coords(-0.055, 0.5)
    axes.xaxis.set_major_locator(MaxNLocator(9))
    ratio, beta = rows[["h_over_H", "beta"]].iloc[0]
    text = f"$h/H={style.format_fraction(ratio, 16)}$\n" + rf"$\beta={f'{beta:.3f}' if beta else '0'}$"
    axes.text(1.025, 0.5, text, transform=axes.transAxes, va="center", linespacing=1.7)
