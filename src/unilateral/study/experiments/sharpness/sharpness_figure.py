"""Rates over alpha at a transition with lambda ~ s_+^alpha, u - g ~ s_-^gamma: measured against predicted."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import ScaledTranslation

from unilateral.arrays import Array
from unilateral.study import style, tables
from unilateral.study.experiments.sharpness import surfaces

TITLES = {
    "discrete": r"$D=\Vert z_h-u_h\Vert_1$ over $H$, at a fixed $h$",
    **{norm: f"{style.NORMS[norm]}, at $H=2h$" for norm in ("hm12", "l2")},
    "consistency": r"consistency term $\langle\Pi_H\lambda,\,u-g\rangle$",
}
COLUMNS = ["kind", "norm", "alpha", "gamma", "rate", "before", "jj"]
HEIGHT = 15.3
PLACES = {"discrete": (1.2, 9.75), "hm12": (9.8, 9.75), "l2": (1.2, 3.15), "consistency": (9.8, 3.15)}
STEP = 1.7
"""The distance in points between markers of several gamma at one alpha, which else would hide each other."""
PREDICTED: style.Look = {"color": "black", "lw": 0.9}
LEFT: style.Look = {"lw": 0.9, "ls": (0, (3, 2))}
PROVED: style.Look = {"color": "0.72", "lw": 3.2, "solid_capstyle": "butt"}
ATTAINED: style.Look = {"marker": "o", "ms": 8.5, "mfc": "none", "mec": "black", "mew": 1.1, "ls": ""}
FAILS: style.Look = {"fc": "0.93", "lw": 0}


def table(rates: style.FilePath, fixed: style.FilePath) -> pd.DataFrame:
    """Rows by `kind`, for D over H at a fixed h, and for lambda's errors and the consistency term at H = 2h.

    `measured`: the finest pair's rate with that of the pair `before`, for D the rate over all levels, per
    alpha and gamma, and whether (jj) holds; `predicted`: points of the predicted lines, a line per gamma for
    the consistency term; `left`: points of what the choice Pi_H lambda leaves of D; `proved`: ends of Theorem
    4.1's line; `attained`: where predicted lines meet it.
    """
    stored, parts = tables.load(rates), []
    for norm in TITLES:
        measured = _of_D(tables.load(fixed)) if norm == "discrete" else _of_pairs(stored, norm)
        rows = measured.to_dataframe(["alpha", "gamma"]).reset_index().assign(kind="measured")
        theory = _theory(norm, stored["alpha"].values, stored["gamma"].values)
        parts.append(pd.concat([rows, *theory]).assign(norm=norm))
    return pd.concat(parts)[COLUMNS]


def _of_D(rates: xr.Dataset) -> xr.Dataset:
    return xr.Dataset({"rate": surfaces.over_all_levels(rates, "discrete"), "jj": rates["jj"]})


def _of_pairs(rates: xr.Dataset, norm: str) -> xr.Dataset:
    rate = rates["consistency_rate"] if norm == "consistency" else rates["rate"].sel(norm=norm, drop=True)
    return xr.Dataset({"rate": rate.isel(pair=-1), "before": rate.isel(pair=-2), "jj": rates["jj"]})


def _theory(norm: str, alphas: Array, gammas: Array) -> Iterator[pd.DataFrame]:
    """The theorem's line and the predicted ones, bends included."""
    proved = surfaces.PROVED[norm]
    yield pd.DataFrame({"kind": "proved", "alpha": [0.0, max(alphas)], "rate": proved})
    if norm == "consistency":
        yield pd.DataFrame({"kind": "attained", "alpha": [0.0], "gamma": 1.0, "rate": proved})
        for gamma in gammas:
            rate = surfaces.of_consistency(alphas, gamma)
            yield pd.DataFrame({"kind": "predicted", "alpha": alphas, "gamma": gamma, "rate": rate})
        return
    yield pd.DataFrame({"kind": "attained", "alpha": [0.0], "rate": proved})
    bends = np.unique([*alphas, 0.0, surfaces.bend(norm)])
    yield pd.DataFrame({"kind": "predicted", "alpha": bends, "rate": surfaces.predicted(norm, bends)})
    for gamma in gammas if norm == "discrete" else ():
        x = np.unique([*bends, np.clip(surfaces.bend_left(norm, gamma), min(alphas), max(alphas))])
        rate = surfaces.left_by_proof(norm, x, gamma)
        yield pd.DataFrame({"kind": "left", "alpha": x, "gamma": gamma, "rate": rate})


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Rates over alpha of D, lambda's errors and the consistency term, a colour and marker per gamma.

    Columns: kind (measured, predicted, left, proved, attained), norm (discrete, hm12, l2, consistency),
    alpha, gamma (empty for lines of all gamma), rate; of measured rates also before (that of the pair before,
    empty for D) and jj (0, 1: whether (jj) holds).
    """
    data = style.read(csv_path)
    gammas = np.unique(data.loc[data["kind"] == "measured", "gamma"]).tolist()
    looks = {gamma: style.look(i) for i, gamma in enumerate(gammas)}
    with style.figure_in(svg_path, HEIGHT) as figure:
        for norm, (left, bottom) in PLACES.items():
            rows = data[data["norm"] == norm]
            axes = style.axes_at(figure, left, bottom, 7.0, 4.8)
            axes.set_title(TITLES[norm])
            axes.set_ylabel("rate")
            _lines(axes, rows[rows["kind"] != "measured"], looks)
            aside = 0 if norm == "consistency" else STEP / 72
            _measured(axes, figure, rows[rows["kind"] == "measured"], looks, aside)
            _scales(axes, rows)
        _key(figure, looks)


def _lines(axes: Axes, rows: pd.DataFrame, looks: dict[float, style.Look]) -> None:
    known = {"proved": {**PROVED, "zorder": 1.2}, "attained": {**ATTAINED, "zorder": 5}}
    for (kind, gamma), line in rows.groupby(["kind", "gamma"], dropna=False):
        colour = looks[gamma]["color"] if gamma in looks else "black"
        dashes = LEFT if kind == "left" else {}
        look = known.get(kind, {"color": colour, "lw": 0.9, "zorder": 2, **dashes})
        axes.plot(line["alpha"], line["rate"], **look)


def _measured(
    axes: Axes, figure: Figure, rows: pd.DataFrame, looks: dict[float, style.Look], aside: float
) -> None:
    """Markers, side by side, with bars to the rates of the pair before."""
    for i, (gamma, look) in enumerate(looks.items()):
        shift = ScaledTranslation((i - 0.5 * (len(looks) - 1)) * aside, 0, figure.dpi_scale_trans)
        beside, of_gamma = axes.transData + shift, rows[rows["gamma"] == gamma]
        paired = of_gamma.dropna(subset="before")
        ends = paired["alpha"], paired["rate"], paired["before"]
        axes.vlines(*ends, color=look["color"], lw=0.9, transform=beside, zorder=3)
        for holds, part in of_gamma.groupby("jj"):
            face, place = look["color"] if holds else "white", (part["alpha"], part["rate"])
            axes.plot(*place, ls="", ms=3.9, mew=0.9, mfc=face, transform=beside, zorder=4, **look)


def _scales(axes: Axes, rows: pd.DataFrame) -> None:
    low, high = np.nanmin(rows[["rate", "before"]]), np.nanmax(rows[["rate", "before"]])
    margin = 0.09 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    first, last = rows["alpha"].min(), rows["alpha"].max()
    axes.set_xlim(first - 0.06 * (last - first), last + 0.06 * (last - first))
    axes.axvspan(axes.get_xlim()[0], 0, zorder=0, **FAILS)
    axes.set_xlabel(r"$\alpha$", labelpad=1)
    axes.xaxis.set_major_locator(MultipleLocator(0.5))
    axes.xaxis.set_minor_locator(MultipleLocator(0.25))
    axes.xaxis.set_major_formatter(lambda alpha, _: f"${Fraction(alpha).limit_denominator(2)}$")
    style.light_grid(axes, "0.88")


def _key(figure: Figure, looks: dict[float, style.Look]) -> None:
    measured = [
        style.key(rf"$\gamma={style.as_fraction(gamma)}$", ls="", ms=4.6, **look)
        for gamma, look in looks.items()
    ]
    measured.append(style.key("(jj) fails", ls="", ms=4.6, marker="o", color="0.25", mfc="white"))
    lines = [
        style.key("Theorems 2 and 4", **PREDICTED),
        style.key(r"what $\mu_H=\Pi_H\lambda$ gives, by $\gamma$", color="0.25", **LEFT),
        style.key("Theorem 4.1 (1980)", **PROVED),
        style.key(r"where it is attained: $\alpha\to 0$", **ATTAINED),
        Patch(label=r"$\alpha\leq 0$: (j) fails", **FAILS),
    ]
    space = {"labelspacing": 0.45, "columnspacing": 1.4, "handlelength": 1.9}
    style.legend(figure, measured, 1.0, 2.0, ncols=3, **space)
    style.legend(figure, lines, 7.9, 2.0, ncols=2, **space)
    note = "Markers, side by side at one $\\alpha$: rates of the finest pair of levels, of $D$ over all"
    style.note(figure, f"{note} levels; bars: to the pair before.", 1.0, 0.25)
