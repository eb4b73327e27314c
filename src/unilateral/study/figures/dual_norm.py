"""The two-sided norm ||.||_{-1/2}: errors between their bounds, the bounds' gap, and what a shortcut says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from unilateral.formulas.formula import real
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Gram
from unilateral.study import tables
from unilateral.study.figures.style import (
    COLOURS,
    FAMILIAR,
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
from unilateral.study.scenes import partitions
from unilateral.study.sizes import normed

FUNCTIONS = {"one": r"$\mu=1$", "alternating": r"$\mu=\pm 1$, cell by cell"}
KINDS = ("error", *FUNCTIONS)
NEGLIGIBLE = 1e-12
"""An error below that part of ||u||_1 is 0 up to rounding."""
COMPARED = 2
DASH = 2.6
NOTE = (
    "Markers: r.m.s. means of the guaranteed bounds, with bars from one to the other; the shortcuts of "
    r"$\mu=1$ and $\mu=\pm1$ are one line."
)


def table(errors: FilePath, norm: FilePath, scene: Mapping[str, Any], h_over_H: object) -> pd.DataFrame:
    """||.||_{-1/2} with its bounds and the shortcut H^{1/2} ||.||_0: errors at one h/H, mu = 1, mu = +-1.

    `norm` holds the forms of the dual norm on the scene's partitions. Errors that are 0 are left out.
    """
    found, gram = tables.load(errors), Gram.of_table(tables.load(norm))
    rows = _of_errors(found, real(h_over_H, "h_over_H"))
    cells = partitions(scene)
    for k in normed(scene):
        rows += _of_functions(gram, cells[k])
    return pd.DataFrame(rows)


def _of_errors(errors: xr.Dataset, h_over_H: float) -> list[dict[str, object]]:
    rows = []
    for case in map(str, errors["case"].values):
        of = errors.sel(case=case)
        lower, upper = (tables.error_in(of, "hm12", bound).values for bound in ("lower", "upper"))
        for i, j in np.argwhere(np.isclose(of["h_over_H"].values, h_over_H, rtol=1e-9)):
            if upper[i, j] > NEGLIGIBLE * float(of["u_norm"][i]):
                h, H, l2 = (float(x) for x in (of["h"][i], of["H"][j], of["l2_error"][i, j]))
                sizes = {"h": h, "H": H, "h_over_H": float(of["h_over_H"][i, j])}
                norms = _norms(float(lower[i, j]), float(upper[i, j]), H, l2)
                rows.append({"kind": "error", "case": case, **sizes, **norms})
    return rows


def _of_functions(gram: Gram, partition: Partition) -> list[dict[str, object]]:
    """Rows of mu = 1 and of mu = +-1, in turn from cell to cell."""
    rows = []
    m, p0 = partition.n_cells, gram.on(partition).p0
    for kind, mu in zip(FUNCTIONS, (np.ones(m), (-1.0) ** np.arange(m)), strict=True):
        lower, upper = (float(mu @ form @ mu) ** 0.5 for form in p0)
        l2 = float(np.sqrt(partition.lengths @ mu**2))
        sizes = {"h": np.nan, "H": partition.H, "h_over_H": np.nan}
        rows.append({"kind": kind, "case": "", **sizes, **_norms(lower, upper, partition.H, l2)})
    return rows


def _norms(lower: float, upper: float, H: float, l2: float) -> dict[str, float]:
    """What is drawn of a function with these bounds and this L2 norm."""
    mean = float(np.sqrt(0.5 * (lower**2 + upper**2)))
    return {"lower": lower, "upper": upper, "mean": mean, "gap": upper / lower - 1, "shortcut": H**0.5 * l2}


def draw(csv_path: FilePath, svg_path: FilePath) -> None:
    """Over H: errors of lambda_H, the relative gap between their bounds, and ||.||_{-1/2} by the shortcut.

    Columns: kind (error, one, alternating), case, h and h_over_H (of errors), H, lower, upper, mean (of the
    bounds), gap (upper/lower - 1), shortcut (H^{1/2} ||.||_0). The shortcut is drawn for both functions and
    the first two cases.
    """
    data = read(csv_path)
    name = data["case"].where(data["kind"] == "error", data["kind"])
    lines = {str(of): rows.sort_values("H") for of, rows in data.groupby(name, sort=False)}
    lines = {of: lines[of] for of in sorted(lines, key=lambda of: of in FUNCTIONS)}
    cases = [of for of in lines if of not in FUNCTIONS]
    with figure_in(svg_path, 9.0) as figure:
        errors, gaps, norms = (axes_at(figure, left, 2.9, 4.4, 5.2) for left in (1.25, 7.05, 12.45))
        for of, rows in lines.items():
            look = _look(of, list(lines))
            if of in cases:
                errors.plot(rows["H"], rows["mean"], **look)
                errors.vlines(rows["H"], rows["lower"], rows["upper"], color=look["color"], lw=3)
            gaps.plot(rows["H"], rows["gap"], **look)
            if of in (*FUNCTIONS, *cases[:COMPARED]):
                norms.plot(rows["H"], rows["mean"], **look)
                norms.plot(rows["H"], rows["shortcut"], **{**look, "marker": "", "ls": _dashes(of)})
        ratios = ", ".join(map(as_fraction, sorted(data["h_over_H"].dropna().unique())))
        errors.set(title=NORMS["hm12"], xlabel=f"cell size $H$  ($h/H={ratios}$)")
        gaps.set(title="upper / lower bound $-$ 1", xlabel="cell size $H$")
        norms.set(title=r"$\Vert\mu\Vert_{-1/2}$ and $H^{1/2}\Vert\mu\Vert_0$", xlabel="cell size $H$")
        for axes in (errors, gaps, norms):
            _sizes(axes, data["H"])
        gaps.yaxis.set_major_formatter(lambda gap, _: f"{100 * gap:g} %")
        _key(figure, list(lines))


def _look(of: str, names: list[str]) -> dict[str, Any]:
    """Cases look as in all figures; the functions take what the cases leave."""
    i = list(dict.fromkeys((*FAMILIAR, *FUNCTIONS, *names))).index(of)
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)], "ms": 4.6, "lw": 1.1}


def _dashes(of: str) -> tuple[float, tuple[float, float]]:
    """The shortcuts of both functions coincide: the dashes of one fill the gaps of the other."""
    return DASH * (of == "alternating"), (DASH, DASH)


def _sizes(axes: Axes, H: pd.Series) -> None:
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    powers = range(int(np.floor(np.log2(H.min()))), 1)
    axes.set_xticks([2.0**k for k in powers], [f"${as_fraction(2.0**k)}$" for k in powers])
    axes.set_xlim(H.min() / 1.3, H.max() * 1.3)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=20))
    light_grid(axes)


def _key(figure: Figure, names: list[str]) -> None:
    labels = [FUNCTIONS.get(of, of) for of in names]
    handles = [
        Line2D([], [], label=label, **_look(of, names)) for of, label in zip(names, labels, strict=True)
    ]
    true = Line2D([], [], color="0.25", lw=1.1, label=r"$\Vert\mu\Vert_{-1/2}$")
    short = Line2D(
        [], [], color="0.25", lw=1.1, ls=_dashes("one"), label=r"the shortcut $H^{1/2}\Vert\mu\Vert_0$"
    )
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.75 / 9), ncols=3)
    figure.legend(handles=[true, short], loc="upper left", bbox_to_anchor=(12 / WIDTH, 1.75 / 9))
    figure.text(0.1 / WIDTH, 0.2 / 9, NOTE, fontsize=SMALL)
