"""Errors over h at fixed h/H: cases differ in colour and marker, ratios in the style of the line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.ticker import LogLocator, NullLocator

from unilateral.errors import InputError
from unilateral.study import tables
from unilateral.study.figures.style import (
    COLOURS,
    FAMILIAR,
    LINES,
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

EXACT = {"h1": r"$u_h=u$ exactly", "hm12": r"$\lambda_H=0$ exactly", "l2": r"$\lambda_H=0$ exactly"}


def table(errors: FilePath, rates: FilePath) -> pd.DataFrame:
    """One row per case, norm, h/H and level: the error, whether it is asymptotic, and the fitted rate.

    Raises InputError if no level has one of the ratios h/H.
    """
    found, fitted = tables.load(errors), tables.load(rates)
    rows = [
        row
        for case in fitted["case"].values
        for norm in NORMS
        for ratio in fitted["h_over_H"].values
        for row in _levels(found.sel(case=case), norm, fitted.sel(case=case, norm=norm, h_over_H=ratio))
    ]
    if not rows:
        ratios = ", ".join(f"{ratio:g}" for ratio in fitted["h_over_H"].values)
        raise InputError(
            f"scene '{found.attrs['scene']}' has no level with h/H = {ratios} to draw rates along"
        )
    return pd.DataFrame(rows)


def _levels(errors: xr.Dataset, norm: str, of: xr.Dataset) -> list[dict[str, object]]:
    """A row for each level with the ratio h/H of the rate `of`."""
    error = tables.error_in(errors, norm).values
    pairs = of["asymptotic"].values == 1
    asymptotic = {*of["h_coarse"].values[pairs], *of["h_fine"].values[pairs]}
    same = np.argwhere(np.isclose(errors["h_over_H"].values, float(of["h_over_H"]), rtol=1e-9))
    return [
        {
            "scene": errors.attrs["scene"],
            "case": str(of["case"].values),
            "norm": norm,
            "h_over_H": float(of["h_over_H"]),
            "h": float(errors["h"][i]),
            "H": float(errors["H"][j]),
            "error": float(error[i, j]),
            "asymptotic": int(float(errors["h"][i]) in asymptotic),
            "rate": float(of["fitted"]),
            "proved": float(of["proved"]),
            "expected": float(of["expected"]),
        }
        for i, j in same
    ]


def draw(csv_path: FilePath, svg_path: FilePath) -> None:
    """Errors over h at fixed h/H in the three norms, with the proved slopes and the observed rates.

    Columns: scene, case, norm (h1, hm12, l2), h_over_H, h, H, error, asymptotic (0, 1), rate, proved,
    expected.
    """
    data = read(csv_path)
    cases, ratios = _numbered(data["case"]), sorted(data["h_over_H"].unique(), reverse=True)
    bottom = 2.6 + 0.42 * len(cases)
    with figure_in(svg_path, bottom + 5.9) as figure:
        legend = axes_at(figure, 0, 0, WIDTH, bottom - 0.9)
        legend.set(xlim=(0, WIDTH), ylim=(0, bottom - 0.9))
        legend.axis("off")
        for left, (norm, title) in zip((1.25, 6.8, 12.35), NORMS.items(), strict=True):
            rows = data[data["norm"] == norm]
            axes = axes_at(figure, left, bottom + 0.2, 4.5, 5.0)
            axes.set_title(title)
            axes.set_xlabel(f"mesh size $h$  ($h/H = {', '.join(map(as_fraction, ratios))}$)")
            _error_lines(axes, rows, cases, ratios)
            _slope(axes, rows)
            _rate_columns(legend, rows, cases, ratios, left)
        _names(legend, cases)


def _error_lines(axes: Axes, rows: pd.DataFrame, cases: dict[str, int], ratios: list[float]) -> None:
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    exact = []
    for case, i in cases.items():
        of_case = rows[(rows["case"] == case) & rows["error"].notna()]
        if len(of_case) and (of_case["error"] == 0).all():
            exact.append(f"{case}: {EXACT[str(rows['norm'].iloc[0])]}")
        for j, ratio in enumerate(ratios):
            line = of_case[(of_case["h_over_H"] == ratio) & (of_case["error"] > 0)].sort_values("h")
            axes.plot(line["h"], line["error"], color=_colour(i), lw=1.1, ls=LINES[j % len(LINES)])
            for asymptotic, part in line.groupby("asymptotic"):
                axes.plot(part["h"], part["error"], ls="", **_marker(i, bool(asymptotic)))
    axes.text(0.04, 0.965, "\n".join(exact), transform=axes.transAxes, va="top", fontsize=SMALL)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (3 if exact else 1))
    powers = range(int(np.floor(np.log2(rows["h"].min()))), 1)
    labels = [f"${as_fraction(2.0**k)}$" if k % 2 else "" for k in powers]
    axes.set_xticks([2.0**k for k in powers], labels)
    axes.set_xlim(rows["h"].min() / 1.3, rows["h"].max() * 1.3)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=20))
    light_grid(axes)


def _numbered(column: pd.Series) -> dict[str, int]:
    """The cases with the numbers of their colours and markers, the familiar ones first."""
    others = [case for case in column.unique() if case not in FAMILIAR]
    numbers = {case: i for i, case in enumerate((*FAMILIAR, *others))}
    return {case: i for case, i in numbers.items() if case in set(column)}


def _colour(i: int) -> str:
    return COLOURS[i % len(COLOURS)]


def _marker(i: int, filled: bool) -> dict[str, Any]:
    face = _colour(i) if filled else "white"
    return {"marker": MARKERS[i % len(MARKERS)], "ms": 4.6, "color": _colour(i), "mfc": face, "mew": 1.0}


def _slope(axes: Axes, rows: pd.DataFrame) -> None:
    """The triangle of the proved slope, at the right, below all lines."""
    proved, drawn = float(rows["proved"].iloc[0]), rows[rows["error"] > 0]
    right = rows["h"].max() / 1.25
    left = right / 3
    near = drawn[drawn["h"] > left / 2]
    base = float((near["error"] * (left / near["h"]) ** proved).min()) / 2 if len(near) else 1.0
    top = base * (right / left) ** proved
    axes.add_patch(Polygon([(left, base), (right, base), (right, top)], fc="0.88", ec="0.25", lw=0.7))
    style_of_text: dict[str, Any] = {"textcoords": "offset points", "fontsize": SMALL}
    middle_x, middle_y = np.sqrt(left * right), np.sqrt(base * top)
    axes.annotate("$1$", (middle_x, base), (0, -2), ha="center", va="top", **style_of_text)
    axes.annotate(f"${as_fraction(proved)}$", (right, middle_y), (2, 0), va="center", **style_of_text)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, base / (high / low) ** 0.09), high)


def _rate_columns(
    legend: Axes, rows: pd.DataFrame, cases: dict[str, int], ratios: list[float], left: float
) -> None:
    """Under a panel, a line per case: its marker, and the rates observed and expected."""
    top = legend.get_ylim()[1]
    text: dict[str, Any] = {"fontsize": SMALL, "va": "center", "ha": "right"}
    right = left + 4.5
    places = [right - 1.5 - 0.85 * (len(ratios) - 1 - j) for j in range(len(ratios))]
    legend.text(places[-1], top - 0.3, "rate at $h/H=$", **text)
    legend.text(right, top - 0.75, "expected", **text)
    for j, (x, ratio) in enumerate(zip(places, ratios, strict=True)):
        legend.text(x, top - 0.75, f"${as_fraction(ratio)}$", **text)
        legend.plot([x - 0.62, x], [top - 1.02] * 2, color="black", lw=1.0, ls=LINES[j % len(LINES)])
    for place, (case, i) in enumerate(cases.items()):
        y, of_case = top - 1.35 - 0.42 * place, rows[rows["case"] == case]
        start = 0.1 if left < 2 else left
        legend.plot([start, start + 0.5], [y, y], color=_colour(i), lw=1.1)
        legend.plot([start + 0.25], [y], ls="", **_marker(i, True))
        for x, ratio in zip(places, ratios, strict=True):
            _number(legend, x, y, of_case.loc[of_case["h_over_H"] == ratio, "rate"])
        _number(legend, right, y, of_case["expected"])


def _number(legend: Axes, x: float, y: float, column: pd.Series) -> None:
    known = column.dropna()
    legend.text(x, y, f"{known.iloc[0]:.2f}" if len(known) else "–", fontsize=SMALL, va="center", ha="right")


def _names(legend: Axes, cases: dict[str, int]) -> None:
    top = legend.get_ylim()[1]
    for i, case in enumerate(cases):
        legend.text(0.7, top - 1.35 - 0.42 * i, case, fontsize=SMALL, va="center")
    note = "Filled markers: asymptotic levels, which the rates are fitted to; open: other levels."
    note += " Triangles: slopes proved."
    legend.text(0.1, 0.3, note, fontsize=SMALL, va="center")
