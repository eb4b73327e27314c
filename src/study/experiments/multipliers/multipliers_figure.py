"""Errors of lambda over h by several methods: a column of panels per case, a row per norm."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from study import style, tables

PANEL_LEFTS_CM = (1.3, 6.85, 12.4)
PANEL_BOTTOMS_CM = {"l2": 2.5, "hm12": 7.4}
PANEL_WIDTH_CM = 4.4
PANEL_HEIGHT_CM = 4.1
"""The left ends of the columns, the lower ends of the rows, and the size of a panel, in cm."""
NORM_LABELS = {"hm12": r"error of $\lambda$ in $H^{-1/2}$", "l2": r"error of $\lambda$ in $L^2$"}
MULTIPLIER_ORDERS = {"hm12": 1.5, "l2": 1.0}
"""The orders of Theorem 4 for these cases, without logarithms."""
ORDER_SCHEME = "order"
LINEAR_ENDING = ", linear"
"""How the names of methods end whose multiplier is made linear."""
MARKER_POINTS = 3.4
ORDER_LINE_FACTOR = 1.5
"""At the coarsest h the line of the order is this many times the largest error."""
ORDER_LOOK: style.Look = {"color": "0.6", "lw": 1.0, "ls": (0, (4, 2))}


def table(errors: style.FilePath) -> pd.DataFrame:
    """A row per case, norm, method and h: the error; and as one more method a line with the order."""
    stored = tables.load_table(errors)
    rows = []
    for norm, order in MULTIPLIER_ORDERS.items():
        error = tables.error_in_norm(stored, norm).rename("error")
        line = (
            ORDER_LINE_FACTOR
            * error.isel(mesh=0, drop=True).max("scheme")
            * (error["h"] / float(error["h"][0])) ** order
        )
        for scheme_rows in (error, line.rename("error").assign_coords(scheme=ORDER_SCHEME)):
            rows.append(scheme_rows.to_dataframe().reset_index().assign(norm=norm))
    return pd.concat(rows)[["case", "norm", "scheme", "h", "error"]]


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Errors over h on logarithmic scales, a colour per method, and the line of the order.

    Columns: case, norm (hm12, l2), scheme (those of the table, and order), h, error.
    """
    data = style.read_figure_table(csv_path)
    schemes = [scheme for scheme in data["scheme"].unique() if scheme != ORDER_SCHEME]
    looks = _choose_looks(schemes)
    top = max(PANEL_BOTTOMS_CM.values()) + PANEL_HEIGHT_CM
    with style.open_figure(svg_path, top + 0.7) as figure:
        for left_cm, (case, case_rows) in zip(PANEL_LEFTS_CM, data.groupby("case", sort=False), strict=True):
            for norm, rows in case_rows.groupby("norm", sort=False):
                bottom_cm = PANEL_BOTTOMS_CM[str(norm)]
                axes = style.add_axes(figure, left_cm, bottom_cm, PANEL_WIDTH_CM, PANEL_HEIGHT_CM)
                _draw_errors(axes, rows, looks)
                if norm == "hm12":
                    axes.set_title(str(case))
                    axes.tick_params(labelbottom=False)
                else:
                    axes.set_xlabel("mesh size $h$", labelpad=1)
                if left_cm == PANEL_LEFTS_CM[0]:
                    axes.set_ylabel(NORM_LABELS[str(norm)], labelpad=1)
        _add_legend(figure, schemes, looks)


def _add_legend(figure: Figure, schemes: list[str], looks: dict[str, style.Look]) -> None:
    labels = {scheme: scheme for scheme in schemes} | {ORDER_SCHEME: r"order $\frac{3}{2}$ above, 1 below"}
    handles = [style.legend_entry(label, **looks[scheme]) for scheme, label in labels.items()]
    style.add_legend(figure, handles, PANEL_LEFTS_CM[0] - 0.8, min(PANEL_BOTTOMS_CM.values()) - 1.2, ncols=3)


def _choose_looks(schemes: list[str]) -> dict[str, style.Look]:
    """A look for each method, and for the line of the order.

    A linear function has the colour and the marker of the multiplier that it is made from, the marker open.
    """
    multipliers = [scheme for scheme in schemes if not scheme.endswith(LINEAR_ENDING)]
    looks = {ORDER_SCHEME: ORDER_LOOK}
    for scheme in schemes:
        is_multiplier = scheme in multipliers
        number = multipliers.index(scheme.removesuffix(LINEAR_ENDING))
        line = {"lw": 1.0, "ls": "-" if is_multiplier else (0, (3, 1.5))}
        looks[scheme] = style.marker_look(number, is_multiplier, MARKER_POINTS) | line
    return looks


def _draw_errors(axes: Axes, rows: pd.DataFrame, looks: dict[str, style.Look]) -> None:
    for scheme, line in rows.groupby("scheme", sort=False):
        style.draw_log_line(axes, line["h"], line["error"], **looks[str(scheme)])
    style.set_size_axes(axes, rows["h"], every=2)
