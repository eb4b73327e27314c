"""Rates over alpha at a transition with lambda ~ s_+^alpha, u - g ~ s_-^gamma: measured against predicted."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from study import style, tables
from study.experiments.sharpness import surfaces
from unilateral.arrays import Array

PANEL_TITLES = {
    "discrete": r"$D$ over $H$, at a fixed $h$",
    **{norm: f"{style.NORM_TITLES[norm]}, at $H=2h$" for norm in ("hm12", "l2")},
}
COLUMNS = ["kind", "norm", "alpha", "gamma", "rate"]
PANEL_BOTTOM_CM = 2.9
PANEL_WIDTH_CM = 4.4
PANEL_HEIGHT_CM = 4.6
PANEL_LEFTS_CM = {"discrete": 1.25, "hm12": 6.85, "l2": 12.45}
"""The left ends of the panels; these and their size are in cm."""
RATE_LOOKS: dict[str, style.Look] = {
    "proved": {"color": "0.72", "lw": 3.2, "solid_capstyle": "butt", "zorder": 1.2},
    "left": {"color": style.COLOURS[1], "lw": 1.1, "ls": (0, (3, 2)), "zorder": 2},
    "predicted": {"color": "black", "lw": 1.0, "zorder": 2},
    "measured": {"color": style.COLOURS[0], "lw": 0.9, "marker": "_", "ms": 6, "mew": 0.9, "zorder": 3},
    "largest": {"color": style.COLOURS[0], "ls": "", "marker": "o", "ms": 4.4, "mec": "white", "zorder": 4},
}
FAILING_LOOK: style.Look = {"fc": "0.93", "lw": 0}


def table(rates: style.FilePath, fixed: style.FilePath) -> pd.DataFrame:
    """Rows by `kind`, for D over H at a fixed h, and for lambda's errors at H = 2h.

    `measured`: the finest pair's rate, for D the rate over all levels, per alpha and gamma; `largest`: that
    of lambda's largest error over gamma, per alpha; `predicted`: points of the predicted line; `left`: points
    of what the choice Pi_H lambda leaves of D for the least gamma; `proved`: ends of Theorem 4.1's line.
    """
    stored = tables.load_table(rates)
    norm_tables = []
    for norm in PANEL_TITLES:
        theory = _tabulate_theory(norm, stored["alpha"].values, float(stored["gamma"].min()))
        norm_tables.append(
            pd.concat([*_tabulate_measured_rates(norm, stored, tables.load_table(fixed)), *theory]).assign(
                norm=norm
            )
        )
    return pd.concat(norm_tables)[COLUMNS]


def _tabulate_measured_rates(norm: str, rates: xr.Dataset, fixed: xr.Dataset) -> Iterator[pd.DataFrame]:
    rate_by_kind = {"measured": surfaces.overall_rate(fixed, "discrete")}
    if norm != "discrete":
        rate_by_kind = {
            "measured": rates["rate"].sel(norm=norm, drop=True).isel(pair=-1),
            "largest": surfaces.largest_error_rate(rates, norm).isel(pair=-1),
        }
    for kind, rate in rate_by_kind.items():
        yield rate.rename("rate").to_dataframe().reset_index().assign(kind=kind)


def _tabulate_theory(norm: str, alphas: Array, smallest_gamma: float) -> Iterator[pd.DataFrame]:
    """The theorem's line and the predicted ones, bends included."""
    yield pd.DataFrame(
        {"kind": "proved", "alpha": [0.0, max(alphas)], "rate": surfaces.THEOREM_4_1_RATES[norm]}
    )
    bends = np.unique([*alphas, 0.0, surfaces.predicted_bend(norm)])
    yield pd.DataFrame({"kind": "predicted", "alpha": bends, "rate": surfaces.predicted_rate(norm, bends)})
    if norm == "discrete":
        x = np.unique([*bends, np.clip(surfaces.proof_bend(norm, smallest_gamma), min(alphas), max(alphas))])
        rate = surfaces.proof_rate(norm, x, smallest_gamma)
        yield pd.DataFrame({"kind": "left", "alpha": x, "gamma": smallest_gamma, "rate": rate})


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Rates over alpha of D and of lambda's errors: a bar over all gamma at each alpha.

    Columns: kind (measured, largest, predicted, left, proved), norm (discrete, hm12, l2), alpha, gamma (empty
    for lines and for the largest error), rate.
    """
    data = style.read_figure_table(csv_path)
    with style.open_figure(svg_path, PANEL_BOTTOM_CM + PANEL_HEIGHT_CM + 0.7) as figure:
        for norm, left_cm in PANEL_LEFTS_CM.items():
            axes = style.add_axes(figure, left_cm, PANEL_BOTTOM_CM, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
            axes.set(title=PANEL_TITLES[norm], ylabel="rate" if norm == "discrete" else "")
            _draw_rate_panel(axes, data[data["norm"] == norm])
        smallest_gamma = style.format_fraction(data["gamma"].min())
        labels = {
            "measured": "observed, a tick for each exponent of the gap",
            "largest": "of the largest error over these",
            "predicted": "Theorems 2 and 4",
            "left": rf"what $\mu=\Pi_H\lambda$ gives, $\gamma=$${smallest_gamma}$",
            "proved": "Theorem 4.1 (1980)",
        }
        handles: list[Artist] = [
            style.legend_entry(label, **RATE_LOOKS[kind]) for kind, label in labels.items()
        ]
        handles.append(Patch(label=r"$\alpha\leq 0$: (j) fails", **FAILING_LOOK))
        style.add_legend(
            figure,
            handles,
            PANEL_LEFTS_CM["discrete"] - 0.8,
            PANEL_BOTTOM_CM - 1.15,
            ncols=2,
            labelspacing=0.45,
        )


def _draw_rate_panel(axes: Axes, rows: pd.DataFrame) -> None:
    for kind, look in RATE_LOOKS.items():
        kind_rows = rows[rows["kind"] == kind]
        lines = (
            kind_rows.groupby("alpha") if kind == "measured" else [("", kind_rows)] * (not kind_rows.empty)
        )
        for _, line in lines:
            axes.plot(line["alpha"], line["rate"], **look)
    first = rows["alpha"].min()
    last = rows["alpha"].max()
    axes.set_xlim(first - 0.06 * (last - first), last + 0.06 * (last - first))
    axes.axvspan(axes.get_xlim()[0], 0, zorder=0, **FAILING_LOOK)
    axes.set_xlabel(r"$\alpha$", labelpad=1)
    axes.xaxis.set_major_locator(MultipleLocator(0.5))
    axes.xaxis.set_major_formatter(lambda alpha, _: f"${Fraction(alpha).limit_denominator(2)}$")
    style.draw_light_grid(axes, "0.88")
