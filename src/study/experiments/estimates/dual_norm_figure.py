"""The two-sided norm ||.||_{-1/2}: errors between their bounds, the bounds' gap, and what a shortcut says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study import style, tables
from study.scenes import normed, partitions
from unilateral.formulas.formula import real
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Gram

FUNCTIONS = {"one": r"$\mu=1$", "alternating": r"$\mu=\pm 1$, cell by cell"}
NEGLIGIBLE = 1e-12
"""An error that is at most this multiple of ||u||_1 is 0 up to rounding."""
COLUMNS = ["kind", "case", "h", "H", "h_over_H", "lower", "upper", "mean", "gap", "shortcut"]
COMPARED = 2
DASH = 2.6
NOTE = (
    "Markers: r.m.s. means of the two bounds, with bars from one to the other; the shortcuts of "
    r"$\mu=1$ and $\mu=\pm1$ are one line."
)


def table(
    errors: style.FilePath, norm: style.FilePath, scene: Mapping[str, Any], h_over_H: object
) -> pd.DataFrame:
    """||.||_{-1/2} with its bounds and the shortcut H^{1/2} ||.||_0: errors at one h/H, mu = 1, mu = +-1.

    `norm` holds the forms of the dual norm on the scene's partitions. Errors that are 0 are left out.
    """
    gram = Gram.of_table(tables.load(norm))
    cells = partitions(scene)
    runs = tables.along_ratio(tables.load(errors), real(h_over_H, "h_over_H"))
    bounds = {bound: tables.error_in(runs, "hm12", bound) for bound in ("lower", "upper")}
    norms = xr.Dataset({**bounds, "l2": tables.error_in(runs, "l2"), "u_norm": runs["u_norm"]})
    errors_of_runs = norms.to_dataframe(["case", "run"]).reset_index().assign(kind="error")
    known = errors_of_runs[errors_of_runs["upper"] > NEGLIGIBLE * errors_of_runs["u_norm"]]
    rows = pd.concat([known, *(_of_functions(gram, cells[k]) for k in normed(scene))])
    lower = rows["lower"]
    upper = rows["upper"]
    l2 = rows["l2"]
    mean = np.sqrt(0.5 * (lower**2 + upper**2))
    shortcut = np.sqrt(rows["H"]) * l2
    return rows.assign(mean=mean, gap=upper / lower - 1, shortcut=shortcut)[COLUMNS]


def _of_functions(gram: Gram, partition: Partition) -> pd.DataFrame:
    """Rows of mu = 1 and of mu = +-1, in turn from cell to cell."""
    m = partition.n_cells
    p0 = gram.on(partition).p0
    rows = []
    for kind, mu in zip(FUNCTIONS, (np.ones(m), (-1.0) ** np.arange(m)), strict=True):
        lower = np.sqrt(mu @ p0.lower @ mu)
        upper = np.sqrt(mu @ p0.upper @ mu)
        l2 = np.sqrt(partition.lengths @ mu**2)
        rows.append({"kind": kind, "case": "", "H": partition.H, "lower": lower, "upper": upper, "l2": l2})
    return pd.DataFrame(rows)


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Over H: errors of lambda_H, the relative gap between their bounds, and ||.||_{-1/2} by the shortcut.

    Columns: kind (error, one, alternating), case, h and h_over_H (of errors), H, lower, upper, mean (of the
    bounds), gap (upper/lower - 1), shortcut (H^{1/2} ||.||_0). The shortcut is drawn for both functions and
    the first two cases.
    """
    data = style.read(csv_path)
    name = data["case"].where(data["kind"] == "error", data["kind"])
    lines = {str(of): rows.sort_values("H") for of, rows in data.groupby(name, sort=False)}
    cases = [of for of in lines if of not in FUNCTIONS]
    numbers = style.numbered([*FUNCTIONS, *cases])  # the functions take what the familiar cases leave
    looks = {of: {**style.look(numbers[of]), "ms": 4.6, "lw": 1.1} for of in [*cases, *FUNCTIONS]}
    with style.figure_in(svg_path, 9.0) as figure:
        errors = style.axes_at(figure, 1.25, 2.9, 4.4, 5.2)
        gaps = style.axes_at(figure, 7.05, 2.9, 4.4, 5.2)
        norms = style.axes_at(figure, 12.45, 2.9, 4.4, 5.2)
        for of, look in looks.items():
            rows = lines[of]
            if of in cases:
                errors.plot(rows["H"], rows["mean"], **look)
                errors.vlines(rows["H"], rows["lower"], rows["upper"], color=look["color"], lw=3)
            gaps.plot(rows["H"], rows["gap"], **look)
            if of in (*FUNCTIONS, *cases[:COMPARED]):
                norms.plot(rows["H"], rows["mean"], **look)
                norms.plot(rows["H"], rows["shortcut"], **{**look, "marker": "", "ls": _dashes(of)})
        ratios = ", ".join(map(style.as_fraction, sorted(data["h_over_H"].dropna().unique())))
        errors.set(title=style.NORMS["hm12"], xlabel=f"cell size $H$  ($h/H={ratios}$)")
        gaps.set(title="upper / lower bound $-$ 1", xlabel="cell size $H$")
        norms.set(title=r"$\Vert\mu\Vert_{-1/2}$ and $H^{1/2}\Vert\mu\Vert_0$", xlabel="cell size $H$")
        for axes in (errors, gaps, norms):
            style.over_sizes(axes, data["H"])
        gaps.yaxis.set_major_formatter(lambda gap, _: f"{100 * gap:g} %")
        handles = [style.key(FUNCTIONS.get(of, of), **look) for of, look in looks.items()]
        grey: style.Look = {"color": "0.25", "lw": 1.1}
        true = style.key(r"$\Vert\mu\Vert_{-1/2}$", **grey)
        short = style.key(r"the shortcut $H^{1/2}\Vert\mu\Vert_0$", ls=_dashes("one"), **grey)
        padded: style.Look = {"borderpad": None, "borderaxespad": None}
        style.legend(figure, handles, 0.0, 1.75, ncols=3, **padded)
        style.legend(figure, [true, short], 12, 1.75, **padded)
        style.note(figure, NOTE)


def _dashes(of: str) -> tuple[float, tuple[float, float]]:
    """The shortcuts of both functions coincide: the dashes of one fill the gaps of the other."""
    return DASH * (of == "alternating"), (DASH, DASH)
