"""Rates over alpha at a transition with lambda ~ s_+^alpha, u - g ~ s_-^gamma: measured against predicted."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from unilateral.study import tables
from unilateral.study.figures.style import (
    COLOURS,
    MARKERS,
    NORMS,
    SMALL,
    WIDTH,
    FilePath,
    as_fraction,
    axes_at,
    figure_in,
    light_grid,
    read,
)
from unilateral.study.judge import surfaces

Array = NDArray[np.float64]
KINDS = ("measured", "predicted", "left", "proved", "attained")
TITLES = {**NORMS, "consistency": r"consistency term $\langle\Pi_H\lambda,\,u-g\rangle$"}
HEIGHT = 15.3
PLACES = {"h1": (1.2, 9.75), "hm12": (9.8, 9.75), "l2": (1.2, 3.15), "consistency": (9.8, 3.15)}
STEP = 1.7
"""Points between markers of different gamma at one alpha, which else would hide each other."""
PREDICTED: dict[str, Any] = {"color": "black", "lw": 0.9}
LEFT: dict[str, Any] = {"lw": 0.9, "ls": (0, (3, 2))}
PROVED: dict[str, Any] = {"color": "0.72", "lw": 3.2, "solid_capstyle": "butt"}
ATTAINED: dict[str, Any] = {"marker": "o", "ms": 8.5, "mfc": "none", "mec": "black", "mew": 1.1, "ls": ""}
FAILS: dict[str, Any] = {"fc": "0.93", "lw": 0}


def table(rates: FilePath) -> pd.DataFrame:
    """Rows by `kind`, in each norm and of the consistency term.

    `measured`: the finest pair's rate with that of the pair `before`, per alpha and gamma, and whether (jj)
    holds; `predicted`: points of the predicted lines, a line per gamma for the consistency term; `left`: of
    what the proof leaves; `proved`: ends of the theorem's line; `attained`: where predicted lines meet it.
    """
    found, rows = tables.load(rates), []
    for norm in TITLES:
        rate = found["consistency_rate"] if norm == "consistency" else found["rate"].sel(norm=norm)
        for a, c in np.ndindex(found.sizes["alpha"], found.sizes["gamma"]):
            last, before = (float(rate[{"pair": k, "alpha": a, "gamma": c}]) for k in (-1, -2))
            where = {"alpha": float(found["alpha"][a]), "gamma": float(found["gamma"][c])}
            jj = int(found["jj"][a, c])
            rows.append({"kind": "measured", "norm": norm, **where, "rate": last, "before": before, "jj": jj})
        rows += _theory(norm, found["alpha"].values, found["gamma"].values)
    return pd.DataFrame(rows)


def _theory(norm: str, alphas: Array, gammas: Array) -> list[dict[str, object]]:
    """The predicted lines, bends included, and the theorem's."""
    proved = surfaces.PROVED[norm]
    found = [{"kind": "proved", "norm": norm, "alpha": x, "rate": proved} for x in (0.0, max(alphas))]
    if norm == "consistency":
        found.append({"kind": "attained", "norm": norm, "alpha": 0.0, "gamma": 1.0, "rate": proved})
        lines = [("predicted", gamma, alphas, surfaces.of_consistency(alphas, gamma)) for gamma in gammas]
    else:
        found.append({"kind": "attained", "norm": norm, "alpha": 0.0, "rate": proved})
        bends = np.unique([*alphas, 0.0, surfaces.bend(norm)])
        lines = [("predicted", np.nan, bends, surfaces.predicted(norm, bends))]
        for gamma in gammas:
            x = np.unique([*bends, np.clip(surfaces.bend_left(norm, gamma), min(alphas), max(alphas))])
            lines.append(("left", gamma, x, surfaces.left_by_proof(norm, x, gamma)))
    for kind, gamma, x, y in lines:
        points = zip(x, y, strict=True)
        found += [{"kind": kind, "norm": norm, "alpha": p, "gamma": gamma, "rate": q} for p, q in points]
    return found


def draw(csv_path: FilePath, svg_path: FilePath) -> None:
    """Rates over alpha in the three norms and of the consistency term, a colour and marker per gamma.

    Columns: kind (measured, predicted, left, proved, attained), norm (h1, hm12, l2, consistency), alpha,
    gamma (empty for lines of all gamma), rate; of measured rates also before (that of the pair before) and
    jj (0, 1: whether (jj) holds).
    """
    data = read(csv_path)
    gammas = sorted(data.loc[data["kind"] == "measured", "gamma"].unique())
    with figure_in(svg_path, HEIGHT) as figure:
        for norm, (left, bottom) in PLACES.items():
            rows = data[data["norm"] == norm]
            axes = axes_at(figure, left, bottom, 7.0, 4.8)
            axes.set_title(TITLES[norm])
            axes.set_ylabel("rate")
            _lines(axes, rows, gammas)
            aside = 0 if norm == "consistency" else STEP / 72
            _measured(axes, figure, rows[rows["kind"] == "measured"], gammas, aside)
            _scales(axes, rows)
        _legend(figure, gammas)


def _look(i: int) -> dict[str, Any]:
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)]}


def _lines(axes: Axes, rows: pd.DataFrame, gammas: list[float]) -> None:
    for kind, line in rows.groupby("kind"):
        if kind == "proved":
            axes.plot(line["alpha"], line["rate"], zorder=1.2, **PROVED)
        if kind == "attained":
            axes.plot(line["alpha"], line["rate"], zorder=5, **ATTAINED)
        if kind in ("predicted", "left"):
            for gamma, of_gamma in line.groupby("gamma", dropna=False):
                drawn = PREDICTED if pd.isna(gamma) else {"color": _colour(gammas, float(gamma)), "lw": 0.9}
                axes.plot(of_gamma["alpha"], of_gamma["rate"], zorder=2, **(drawn | _dashes(str(kind))))


def _colour(gammas: list[float], gamma: float) -> str:
    return str(_look(gammas.index(gamma))["color"])


def _dashes(kind: str) -> dict[str, Any]:
    return LEFT if kind == "left" else {}


def _measured(axes: Axes, figure: Figure, rows: pd.DataFrame, gammas: list[float], aside: float) -> None:
    """Markers, side by side, with bars to the rates of the pair before."""
    for i, gamma in enumerate(gammas):
        shift = ScaledTranslation((i - 0.5 * (len(gammas) - 1)) * aside, 0, figure.dpi_scale_trans)
        beside = axes.transData + shift
        of_gamma, look = rows[rows["gamma"] == gamma], _look(i)
        ends = of_gamma["alpha"], of_gamma["rate"], of_gamma["before"]
        axes.vlines(*ends, color=look["color"], lw=0.9, transform=beside, zorder=3)
        for holds, part in of_gamma.groupby("jj"):
            face = look["color"] if holds else "white"
            place = part["alpha"], part["rate"]
            axes.plot(*place, ls="", ms=3.9, mew=0.9, mfc=face, transform=beside, zorder=4, **look)


def _scales(axes: Axes, rows: pd.DataFrame) -> None:
    seen = rows[["rate", "before"]].to_numpy()
    low, high = float(pd.Series(seen.ravel()).min()), float(pd.Series(seen.ravel()).max())
    margin = 0.09 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    width = rows["alpha"].max() - rows["alpha"].min()
    axes.set_xlim(rows["alpha"].min() - 0.06 * width, rows["alpha"].max() + 0.06 * width)
    axes.axvspan(axes.get_xlim()[0], 0, zorder=0, **FAILS)
    axes.set_xlabel(r"$\alpha$", labelpad=1)
    axes.xaxis.set_major_locator(MultipleLocator(0.5))
    axes.xaxis.set_minor_locator(MultipleLocator(0.25))
    axes.xaxis.set_major_formatter(lambda alpha, _: f"${Fraction(alpha).limit_denominator(2)}$")
    light_grid(axes, "0.88")


def _legend(figure: Figure, gammas: list[float]) -> None:
    measured = [
        Line2D([], [], ls="", ms=4.6, label=rf"$\gamma={as_fraction(gamma)}$", **_look(i))
        for i, gamma in enumerate(gammas)
    ]
    failing = Line2D([], [], ls="", ms=4.6, marker="o", color="0.25", mfc="white", label="(jj) fails")
    lines = [
        Line2D([], [], label="predicted", **PREDICTED),
        Line2D([], [], label=r"$m+c^{1/2}$ in the proof, by $\gamma$", color="0.25", **LEFT),
        Line2D([], [], label="proved by Theorem 4.1", **PROVED),
        Line2D([], [], label=r"where it is attained: $\alpha\to 0$", **ATTAINED),
        Patch(label=r"$\alpha\leq 0$: (j) fails", **FAILS),
    ]
    for handles, left, columns in (([*measured, failing], 1.0, 2), (lines, 6.7, 2)):
        figure.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(left / WIDTH, 2.0 / HEIGHT),
            ncols=columns,
            borderpad=0,
            borderaxespad=0,
            labelspacing=0.45,
            columnspacing=1.4,
            handlelength=1.9,
        )
    note = "Markers: rates of the finest pair of levels, side by side at one $\\alpha$;"
    note += " bars: to the rate of the pair before."
    figure.text(1.0 / WIDTH, 0.25 / HEIGHT, note, fontsize=SMALL)
