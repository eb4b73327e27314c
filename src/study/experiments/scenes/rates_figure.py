"""Errors over h at fixed h/H: cases differ in colour and marker, ratios in the style of the line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from study import style, tables
from unilateral.errors import InputError

EXACT = {"h1": r"$u_h=u$ exactly", "hm12": r"$\lambda_H=0$ exactly", "l2": r"$\lambda_H=0$ exactly"}
MARKER = 4.6
ROW = 0.42
"""Centimetres between two cases in the key."""
INDEX = ["case", "norm", "h_over_H"]
COLUMNS = ["scene", *INDEX, "h", "H", "error", "asymptotic", "rate", "proved", "expected"]


def table(errors: style.FilePath, rates: style.FilePath) -> pd.DataFrame:
    """One row per case, norm, h/H and level: the error, whether it is asymptotic, and the fitted rate.

    A ratio h/H at which nothing was solved has no rows. Raises InputError if no ratio has any.
    """
    solved = tables.load(errors)
    fitted = tables.load(rates)
    all_parts = [_along(solved, fitted.sel(h_over_H=ratio)) for ratio in fitted["h_over_H"].values]
    parts = [part for part in all_parts if part["error"].notna().any()]
    if not parts:
        ratios = ", ".join(f"{ratio:g}" for ratio in fitted["h_over_H"].values)
        raise InputError(
            f"scene '{solved.attrs['scene']}' has no level with h/H = {ratios} to draw rates along"
        )
    rows = pd.concat(parts).sort_values(INDEX, kind="stable")
    return rows.assign(scene=solved.attrs["scene"])[COLUMNS]


def _along(errors: xr.Dataset, of: xr.Dataset) -> pd.DataFrame:
    """A row for each level with the ratio h/H of the rates `of`, of all cases and norms."""
    runs = tables.along_ratio(errors, float(of["h_over_H"])).drop_vars("h_over_H")
    ends = (runs["h"] == of["h_coarse"]) | (runs["h"] == of["h_fine"])
    asymptotic = (ends & (of["asymptotic"] == 1)).any("pair").astype(int)
    rates = of[["fitted", "proved", "expected"]].rename(fitted="rate")
    levels = rates.assign(error=tables.errors_in_all(runs), asymptotic=asymptotic)
    return levels.to_dataframe(["case", "norm", "run"]).reset_index()


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Errors over h at fixed h/H in the three norms, with the proved slopes and the observed rates.

    Columns: scene, case, norm (h1, hm12, l2), h_over_H, h, H, error, asymptotic (0, 1), rate, proved,
    expected.
    """
    data = style.read(csv_path)
    cases = style.numbered(data["case"])
    ratios = sorted(data["h_over_H"].unique(), reverse=True)
    bottom = 2.6 + ROW * len(cases)
    with style.figure_in(svg_path, bottom + 5.9) as figure:
        key = style.axes_at(figure, 0, 0, style.WIDTH, bottom - 0.9)
        key.set(xlim=(0, style.WIDTH), ylim=(0, bottom - 0.9))
        key.axis("off")
        for left, (norm, title) in zip((1.25, 6.8, 12.35), style.NORMS.items(), strict=True):
            rows = data[data["norm"] == norm]
            axes = style.axes_at(figure, left, bottom + 0.2, 4.5, 5.0)
            axes.set_title(title)
            axes.set_xlabel(f"mesh size $h$  ($h/H = {', '.join(map(style.as_fraction, ratios))}$)")
            _error_lines(axes, rows, cases, ratios)
            _slope(axes, rows)
            _rate_columns(key, rows, cases, ratios, left)
        for i, case in enumerate(cases):
            key.text(0.7, bottom - 0.9 - 1.35 - ROW * i, case, fontsize=style.SMALL, va="center")
        note = "Filled markers: asymptotic levels, which the rates are fitted to; open: other levels."
        key.text(0.1, 0.3, f"{note} Triangles: slopes proved.", fontsize=style.SMALL, va="center")


def _error_lines(axes: Axes, rows: pd.DataFrame, cases: dict[str, int], ratios: list[float]) -> None:
    style.over_sizes(axes, rows["h"], every=2)
    exact = []
    for case, i in cases.items():
        of_case = rows[(rows["case"] == case) & rows["error"].notna()]
        if len(of_case) and (of_case["error"] == 0).all():
            exact.append(f"{case}: {EXACT[str(rows['norm'].iloc[0])]}")
        for j, ratio in enumerate(ratios):
            line = of_case[(of_case["h_over_H"] == ratio) & (of_case["error"] > 0)].sort_values("h")
            axes.plot(line["h"], line["error"], **_line(i), ls=_dashes(j))
            for asymptotic, part in line.groupby("asymptotic"):
                axes.plot(part["h"], part["error"], ls="", **style.marked(i, bool(asymptotic), MARKER))
    axes.text(0.04, 0.965, "\n".join(exact), transform=axes.transAxes, va="top", fontsize=style.SMALL)
    low, high = axes.get_ylim()
    axes.set_ylim(*style.whole_decades(low, high * (3 if exact else 1)))


def _line(i: int) -> style.Look:
    return {"color": style.look(i)["color"], "lw": 1.1}


def _dashes(j: int) -> str | tuple[float, tuple[float, float]]:
    return style.LINES[j % len(style.LINES)]


def _slope(axes: Axes, rows: pd.DataFrame) -> None:
    """The triangle of the proved slope, at the right, below all lines."""
    proved = float(rows["proved"].iloc[0])
    drawn = rows[rows["error"] > 0]
    right = rows["h"].max() / 1.25
    left = right / 3
    near = drawn[drawn["h"] > left / 2]
    base = float((near["error"] * (left / near["h"]) ** proved).min()) / 2 if len(near) else 1.0
    top = base * (right / left) ** proved
    axes.add_patch(Polygon([(left, base), (right, base), (right, top)], fc="0.88", ec="0.25", lw=0.7))
    beside: style.Look = {"textcoords": "offset points", "fontsize": style.SMALL}
    middle_x = np.sqrt(left * right)
    middle_y = np.sqrt(base * top)
    axes.annotate("$1$", (middle_x, base), (0, -2), ha="center", va="top", **beside)
    axes.annotate(f"${style.as_fraction(proved)}$", (right, middle_y), (2, 0), va="center", **beside)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, base / (high / low) ** 0.09), high)


def _rate_columns(
    key: Axes, rows: pd.DataFrame, cases: dict[str, int], ratios: list[float], left: float
) -> None:
    """Under a panel, a line per case: its marker, and the rates observed and expected."""
    top = key.get_ylim()[1]
    text: style.Look = {"fontsize": style.SMALL, "va": "center", "ha": "right"}
    right = left + 4.5
    places = [right - 1.5 - 0.85 * (len(ratios) - 1 - j) for j in range(len(ratios))]
    key.text(places[-1], top - 0.3, "rate at $h/H=$", **text)
    key.text(right, top - 0.75, "expected", **text)
    for j, (x, ratio) in enumerate(zip(places, ratios, strict=True)):
        key.text(x, top - 0.75, f"${style.as_fraction(ratio)}$", **text)
        key.plot([x - 0.62, x], [top - 1.02] * 2, color="black", lw=1.0, ls=_dashes(j))
    for place, (case, i) in enumerate(cases.items()):
        y = top - 1.35 - ROW * place
        of_case = rows[rows["case"] == case]
        start = 0.1 if left < 2 else left
        key.plot([start, start + 0.5], [y, y], **_line(i))
        key.plot([start + 0.25], [y], ls="", **style.marked(i, True, MARKER))
        observed = [of_case.loc[of_case["h_over_H"] == ratio, "rate"] for ratio in ratios]
        if of_case["rate"].isna().all():
            errors = of_case["error"].dropna()
            reason = "exact" if (errors == 0).all() else "no asymptotic level"
            key.text(right, y, "error not computed" if errors.empty else reason, **text)
            continue
        for x, column in zip([*places, right], [*observed, of_case["expected"]], strict=True):
            known = column.dropna()
            key.text(x, y, f"{known.iloc[0]:.2f}" if len(known) else "–", **text)
