"""Errors over h at fixed h/H: cases differ in colour and marker, ratios in the style of the line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from study import style, tables
from study.formats import DASH
from unilateral.errors import InputError

EXACT_NOTES = {"h1": r"$u_h=u$ exactly", "hm12": r"$\lambda_H=0$ exactly", "l2": r"$\lambda_H=0$ exactly"}
ERROR_MARKER_POINTS = 4.6
KEY_ROW_CM = 0.42
"""Centimetres between two cases in the key."""
LINE_INDEX = ["case", "norm", "h_over_H"]
COLUMNS = ["scene", *LINE_INDEX, "h", "H", "error", "asymptotic", "rate", "proved", "expected"]


def table(errors: style.FilePath, rates: style.FilePath) -> pd.DataFrame:
    """One row per case, norm, h/H and level: the error, whether it is asymptotic, and the fitted rate.

    A ratio h/H at which nothing was solved has no rows. Raises InputError if no ratio has any.
    """
    solved = tables.load_table(errors)
    fitted = tables.load_table(rates)
    ratio_tables = [
        _tabulate_ratio(solved, fitted.sel(h_over_H=ratio)) for ratio in fitted["h_over_H"].values
    ]
    known_tables = [ratio_table for ratio_table in ratio_tables if ratio_table["error"].notna().any()]
    if not known_tables:
        ratios = ", ".join(f"{ratio:g}" for ratio in fitted["h_over_H"].values)
        raise InputError(
            f"scene '{solved.attrs['scene']}' has no level with h/H = {ratios} to draw rates along"
        )
    rows = pd.concat(known_tables).sort_values(LINE_INDEX, kind="stable")
    return rows.assign(scene=solved.attrs["scene"])[COLUMNS]


def _tabulate_ratio(errors: xr.Dataset, rates_at_ratio: xr.Dataset) -> pd.DataFrame:
    """A row for each level with the ratio h/H of the rates `rates_at_ratio`, of all cases and norms."""
    runs = tables.select_ratio(errors, float(rates_at_ratio["h_over_H"])).drop_vars("h_over_H")
    ends = (runs["h"] == rates_at_ratio["h_coarse"]) | (runs["h"] == rates_at_ratio["h_fine"])
    asymptotic = (ends & (rates_at_ratio["asymptotic"] == 1)).any("pair").astype(int)
    rates = rates_at_ratio[["fitted", "proved", "expected"]].rename(fitted="rate")
    levels = rates.assign(error=tables.errors_in_all_norms(runs), asymptotic=asymptotic)
    return levels.to_dataframe(["case", "norm", "run"]).reset_index()


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Errors over h at fixed h/H in the three norms, with the proved slopes and the observed rates.

    Columns: scene, case, norm (h1, hm12, l2), h_over_H, h, H, error, asymptotic (0, 1), rate, proved,
    expected.
    """
    data = style.read_figure_table(csv_path)
    cases = style.number_looks(data["case"])
    ratios = sorted(data["h_over_H"].unique(), reverse=True)
    bottom = 2.6 + KEY_ROW_CM * len(cases)
    with style.open_figure(svg_path, bottom + 5.9) as figure:
        key = style.add_axes(figure, 0, 0, style.PAGE_WIDTH_CM, bottom - 0.9)
        key.set(xlim=(0, style.PAGE_WIDTH_CM), ylim=(0, bottom - 0.9))
        key.axis("off")
        for left_cm, (norm, title) in zip((1.25, 6.8, 12.35), style.NORM_TITLES.items(), strict=True):
            rows = data[data["norm"] == norm]
            axes = style.add_axes(figure, left_cm, bottom + 0.2, 4.5, 5.0)
            axes.set_title(title)
            axes.set_xlabel(f"mesh size $h$  ($h/H = {', '.join(map(style.format_fraction, ratios))}$)")
            _draw_error_lines(axes, rows, cases, ratios)
            _draw_proved_slope(axes, rows)
            _draw_rate_columns(key, rows, cases, ratios, left_cm)
        for i, case in enumerate(cases):
            key.text(
                0.7, bottom - 0.9 - 1.35 - KEY_ROW_CM * i, case, fontsize=style.SMALL_FONT_POINTS, va="center"
            )
        note = "Filled markers: asymptotic levels, which the rates are fitted to; open: other levels."
        key.text(0.1, 0.3, f"{note} Triangles: slopes proved.", fontsize=style.SMALL_FONT_POINTS, va="center")


def _draw_error_lines(axes: Axes, rows: pd.DataFrame, cases: dict[str, int], ratios: list[float]) -> None:
    style.set_size_axes(axes, rows["h"], every=2)
    exact = []
    for case, i in cases.items():
        case_rows = rows[(rows["case"] == case) & rows["error"].notna()]
        if len(case_rows) and (case_rows["error"] == 0).all():
            exact.append(f"{case}: {EXACT_NOTES[str(rows['norm'].iloc[0])]}")
        for j, ratio in enumerate(ratios):
            line = case_rows[(case_rows["h_over_H"] == ratio) & (case_rows["error"] > 0)].sort_values("h")
            axes.plot(line["h"], line["error"], **_line_look(i), ls=_ratio_dashes(j))
            for asymptotic, marked_rows in line.groupby("asymptotic"):
                axes.plot(
                    marked_rows["h"],
                    marked_rows["error"],
                    ls="",
                    **style.marker_look(i, bool(asymptotic), ERROR_MARKER_POINTS),
                )
    axes.text(
        0.04, 0.965, "\n".join(exact), transform=axes.transAxes, va="top", fontsize=style.SMALL_FONT_POINTS
    )
    low, high = axes.get_ylim()
    axes.set_ylim(*style.widen_to_decades(low, high * (3 if exact else 1)))


def _line_look(i: int) -> style.Look:
    return {"color": style.numbered_look(i)["color"], "lw": 1.1}


def _ratio_dashes(j: int) -> str | tuple[float, tuple[float, float]]:
    return style.LINE_STYLES[j % len(style.LINE_STYLES)]


def _draw_proved_slope(axes: Axes, rows: pd.DataFrame) -> None:
    """The triangle of the proved slope, at the right, below all lines."""
    proved = float(rows["proved"].iloc[0])
    drawn = rows[rows["error"] > 0]
    x1 = rows["h"].max() / 1.25
    x0 = x1 / 3
    near = drawn[drawn["h"] > x0 / 2]
    base = float((near["error"] * (x0 / near["h"]) ** proved).min()) / 2 if len(near) else 1.0
    top = base * (x1 / x0) ** proved
    axes.add_patch(Polygon([(x0, base), (x1, base), (x1, top)], fc="0.88", ec="0.25", lw=0.7))
    beside: style.Look = {"textcoords": "offset points", "fontsize": style.SMALL_FONT_POINTS}
    middle_x = np.sqrt(x0 * x1)
    middle_y = np.sqrt(base * top)
    axes.annotate("$1$", (middle_x, base), (0, -2), ha="center", va="top", **beside)
    axes.annotate(f"${style.format_fraction(proved)}$", (x1, middle_y), (2, 0), va="center", **beside)
    low, high = axes.get_ylim()
    axes.set_ylim(min(low, base / (high / low) ** 0.09), high)


def _draw_rate_columns(
    key: Axes, rows: pd.DataFrame, cases: dict[str, int], ratios: list[float], left_cm: float
) -> None:
    """Under a panel, a line per case: its marker, and the rates observed and expected."""
    top = key.get_ylim()[1]
    text: style.Look = {"fontsize": style.SMALL_FONT_POINTS, "va": "center", "ha": "right"}
    right = left_cm + 4.5
    places = [right - 1.5 - 0.85 * (len(ratios) - 1 - j) for j in range(len(ratios))]
    key.text(places[-1], top - 0.3, "rate at $h/H=$", **text)
    key.text(right, top - 0.75, "expected", **text)
    for j, (x, ratio) in enumerate(zip(places, ratios, strict=True)):
        key.text(x, top - 0.75, f"${style.format_fraction(ratio)}$", **text)
        key.plot([x - 0.62, x], [top - 1.02] * 2, color="black", lw=1.0, ls=_ratio_dashes(j))
    for place, (case, i) in enumerate(cases.items()):
        y = top - 1.35 - KEY_ROW_CM * place
        start = 0.1 if left_cm < 2 else left_cm
        key.plot([start, start + 0.5], [y, y], **_line_look(i))
        key.plot([start + 0.25], [y], ls="", **style.marker_look(i, True, ERROR_MARKER_POINTS))
        case_rows = rows[rows["case"] == case]
        if case_rows["rate"].isna().all():
            key.text(right, y, _explain_missing_rate(case_rows), **text)
            continue
        observed = [case_rows.loc[case_rows["h_over_H"] == ratio, "rate"] for ratio in ratios]
        for x, column in zip([*places, right], [*observed, case_rows["expected"]], strict=True):
            key.text(x, y, _format_rate(column), **text)


def _explain_missing_rate(case_rows: pd.DataFrame) -> str:
    """Why a case has no rate: its errors are not computed, or 0, or none is on an asymptotic level."""
    errors = case_rows["error"].dropna()
    if errors.empty:
        return "error not computed"
    return "exact" if (errors == 0).all() else "no asymptotic level"


def _format_rate(column: pd.Series) -> str:
    """The first known rate of a column, or a dash."""
    rates = column.dropna()
    return f"{rates.iloc[0]:.2f}" if len(rates) else DASH
