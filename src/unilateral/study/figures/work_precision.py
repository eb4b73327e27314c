"""Error against work, and what is behind it: the growth of the steps, the price of a step, when to stop."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from unilateral.study.figures.rates import MARKERS
from unilateral.study.figures.style import (
    COLOURS,
    NORMS,
    SMALL,
    WIDTH,
    FilePath,
    as_fraction,
    axes_at,
    figure_in,
    read,
)

WORK_COLUMNS = (
    *("kind", "norm", "label", "H_over_h", "H", "unknowns", "stop"),
    *("work", "error", "steps", "slope", "excess"),
)
KINDS = ("front", "line", "steps", "step", "stop")
ALGORITHMS: dict[str, tuple[str, dict[str, Any]]] = {
    "uzawa": (r"Uzawa, $\rho=1.9/\lambda_{\max}(S)$", {"color": COLOURS[0], "marker": "o", "ms": 5.2}),
    "safe": (r"Uzawa, safe: $\rho=1.9\,\sigma_1$", {"color": COLOURS[6], "marker": "P", "ms": 3.4}),
    "optimal": (
        r"Uzawa, $\rho=2/(\lambda_{\min}+\lambda_{\max})$",
        {"color": COLOURS[4], "marker": "x", "ms": 2.6},
    ),
    "nesterov": ("Nesterov, restarted", {"color": COLOURS[1], "marker": "s", "ms": 3.2}),
    "barzilai_borwein": ("projected Barzilai–Borwein", {"color": COLOURS[2], "marker": "^", "ms": 3.8}),
    "newton": ("primal–dual active set", {"color": COLOURS[3], "marker": "D", "ms": 3.0}),
}
MATRICES: dict[str, tuple[str, dict[str, Any]]] = {
    "A": ("solve with $A$", {"color": COLOURS[0], "marker": "o"}),
    "A_3": ("solve with $A_3$", {"color": COLOURS[1], "marker": "s"}),
    "S": ("multiply by $S$", {"color": COLOURS[2], "marker": "^"}),
    "setup_A": ("set-up, with $A$", {"color": COLOURS[0], "marker": "", "ls": (0, (3, 2))}),
    "setup_S": ("set-up, with $S$", {"color": COLOURS[2], "marker": "", "ls": (0, (3, 2))}),
}
STOPS = {"h1": (COLOURS[0], "o"), "hm12": (COLOURS[1], "s"), "l2": (COLOURS[2], "^")}
LEFT, ACROSS, TALL = (1.35, 6.95, 12.55), 4.25, 4.3
HEIGHT = 14.8
FRONT: dict[str, Any] = {"color": "0.75", "lw": 3.0, "marker": "", "solid_joinstyle": "round"}
LAST_STOP = 1e-5
"""What is below it is drawn nowhere: all errors are then those of the discrete solution."""


def work_precision(csv_path: FilePath, svg_path: FilePath, work: str = "operations") -> None:
    """Above: relative errors over work at fixed H/h, and the front of all. Below: steps, one step, stops.

    Columns: kind (front, line, steps, step, stop), norm, label (algorithm or matrix), H_over_h, H, unknowns,
    stop, work, error, steps, slope (p of steps ~ H^-p), excess. `work` is "operations" or "seconds". Raises
    InputError for a table without them.
    """
    table = read(csv_path, WORK_COLUMNS, {"kind": KINDS})
    parts = {kind: rows for kind, rows in table.groupby("kind")}
    ratios = sorted(parts["line"]["H_over_h"].unique())
    with figure_in(svg_path, HEIGHT) as figure:
        for left, (norm, title) in zip(LEFT, NORMS.items(), strict=True):
            axes = axes_at(figure, left, 9.4, ACROSS, TALL)
            rows = parts["front"][parts["front"]["norm"] == norm]
            _line(axes, rows["work"], rows["error"], FRONT)
            for ratio, rows in parts["line"][parts["line"]["norm"] == norm].groupby("H_over_h"):
                _line(axes, rows["work"], rows["error"], _look(ratios, float(ratio)))
            axes.set(title=f"{title}, relative", xlabel=work)
            axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axes.yaxis.set_major_formatter("{x:g}")
            axes.yaxis.set_minor_locator(NullLocator())
        lower = [axes_at(figure, left, 2.4, ACROSS, TALL) for left in LEFT]
        _steps(lower[0], parts["steps"])
        _step(lower[1], parts["step"], work)
        _stop(lower[2], parts["stop"])
        fronts = [Line2D([], [], label=f"$H/h={as_fraction(r)}$", **_look(ratios, r)) for r in ratios]
        _legend(figure, [*fronts, Line2D([], [], label="front of all runs", **FRONT)], 8.2, 7)
        named = [Line2D([], [], label=name, lw=0.9, **look) for name, look in ALGORITHMS.values()]
        _legend(figure, named, 1.25, 3)


def _look(ratios: list[float], ratio: float) -> dict[str, Any]:
    i = ratios.index(ratio)
    return {"color": COLOURS[i], "marker": MARKERS[i], "lw": 0.9, "ms": 3.6, "mec": "white", "mew": 0.3}


def _line(axes: Axes, x: pd.Series, y: pd.Series, look: dict[str, Any]) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(which="major", color="0.9", lw=0.5)
    axes.set_axisbelow(True)
    axes.plot(x, y, **look)


def _steps(axes: Axes, rows: pd.DataFrame) -> None:
    """With fitted exponents, if any, beside the finest points; one where lines coincide."""
    ends: list[float] = []
    for label, line in rows.groupby("label", sort=False):
        look = {**ALGORITHMS[str(label)][1], "lw": 0.9}
        _line(axes, line["H"], line["steps"], look)
        end = line.loc[line["H"].idxmin()]
        if end["slope"] == end["slope"] and all(not 0.8 < end["steps"] / other < 1.25 for other in ends):
            place: dict[str, Any] = {"xytext": (5, 0), "textcoords": "offset points", "va": "center"}
            text = f"$H^{{-{end['slope']:.1f}}}$"
            axes.annotate(text, (end["H"], end["steps"]), color=look["color"], fontsize=SMALL, **place)
            ends.append(end["steps"])
    sizes = sorted(rows["H"].unique(), reverse=True)
    axes.set_xlim(1.3 * sizes[0], sizes[-1] / 5.0)
    axes.set_xticks(sizes[::2], [as_fraction(H) for H in sizes[::2]])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set(title=r"steps to the level $10^{-6}$", xlabel="$H$")


def _step(axes: Axes, rows: pd.DataFrame, work: str) -> None:
    for label, (name, look) in MATRICES.items():
        line = rows[rows["label"] == label]
        _line(axes, line["unknowns"], line["work"], {**look, "lw": 0.9, "ms": 3.6, "label": name})
    axes.set(title=f"{work}: a step, the set-up", xlabel="unknowns in $\\Omega$")
    axes.set_ylim(top=200 * axes.get_ylim()[1])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.legend(loc="upper left", borderpad=0, borderaxespad=0.4, labelspacing=0.25, handlelength=1.6)


def _stop(axes: Axes, rows: pd.DataFrame) -> None:
    for norm, line in rows[rows["stop"] >= LAST_STOP].groupby("norm", sort=False):
        colour, marker = STOPS[str(norm)]
        look = {"color": colour, "marker": marker, "lw": 0.9, "ms": 3.6, "label": NORMS[str(norm)]}
        _line(axes, line["stop"], line["excess"], look)
    axes.invert_xaxis()
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_yticks([1, 2, 5, 10, 20, 50], ["1", "2", "5", "10", "20", "50"])
    axes.set(title=r"error, over that of $(u_h,\lambda_H)$", xlabel="stopping level")
    axes.legend(loc="upper right", borderpad=0, borderaxespad=0.4, labelspacing=0.25, handlelength=1.6)


def _legend(figure: Figure, handles: list[Line2D], top: float, columns: int) -> None:
    corner = (1.35 / WIDTH, top / HEIGHT)
    space: dict[str, float] = {"borderpad": 0, "borderaxespad": 0, "labelspacing": 0.4, "columnspacing": 1.15}
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=corner, ncols=columns, handlelength=1.6, **space
    )
