"""The numbers in documents about adapted meshes beside uniform ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from study.formats import shown
from study.scenes import is_clamped
from unilateral.norms.resolution import RULE

NONE = "–"
COLUMNS = {
    "unknowns": ("unknowns", "space"),
    "multipliers": ("multipliers", ".0f"),
    "longest edge": ("diameter", ".2g"),
    "shortest, on the boundary": ("shortest_edge", "short"),
    r"$\Vert u-u_h\Vert_1$": ("h1_error", "short"),
    "bound": ("h1_bound", "up.short"),
    "bound / error": ("index", ".2f"),
    "rate, error": ("error_rate", ".2f"),
    "rate, bound": ("bound_rate", ".2f"),
}


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    return {"adapted": beta(apart(results["adaptive/infsup"])[0], RULE.smallest_angle)}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    measured, clamped = apart(results["adaptive/errors"].merge(results["adaptive/rates"]))
    return {
        "adapted": finest(measured),
        "adapted-savings": savings(measured),
        "adapted-clamped": finest(clamped),
    }


def apart(table: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """The problems without clamped sides, and those with some."""
    clamped = np.array([is_clamped(name) for name in table["case"].values])
    return table.isel(case=~clamped), table.isel(case=clamped)


def finest(of: xr.Dataset) -> pd.DataFrame:
    """The finest level of each kind of mesh, by problem, and the rates on the finest pair."""
    rows = []
    for case in of["case"].values:
        for kind in of["kind"].values:
            levels = of.sel(case=case, kind=kind).dropna("level", subset=["unknowns"])
            row = {"problem": f"`{case}`", "meshes": str(kind)}
            for title, (name, spec) in COLUMNS.items():
                last = _last(levels[name])
                row[title] = shown(last, spec) if np.isfinite(last) else NONE
            rows.append(row)
    return pd.DataFrame(rows)


def _last(values: xr.DataArray) -> float:
    """The last value that is known, or NaN."""
    known = values.dropna("level").values
    return float(known[-1]) if len(known) else np.nan


def savings(errors: xr.Dataset) -> pd.DataFrame:
    """How many unknowns adapted meshes save for the bound of the finest uniform mesh, by problem.

    These are the unknowns of the first mesh of each kind with that bound, and the quotients, uniform over
    adapted, of these meshes and of all levels up to them.
    """
    rows = []
    for case in errors["case"].values:
        of = errors.sel(case=case)
        target = _last(of["h1_bound"].sel(kind="uniform"))
        uniform = _until(of.sel(kind="uniform"), target)
        adapted = _until(of.sel(kind="adapted"), target)
        rows.append(
            {
                "problem": f"`{case}`",
                "bound": shown(target, "up.short"),
                "uniform": shown(uniform[-1], "space"),
                "adapted": shown(adapted[-1], "space"),
                "fewer": shown(uniform[-1] / adapted[-1], ".1f"),
                "of all levels": shown(uniform.sum() / adapted.sum(), ".1f"),
            }
        )
    return pd.DataFrame(rows)


def _until(of: xr.Dataset, target: float) -> NDArray[np.float64]:
    """The unknowns of the levels up to the first with that bound."""
    return np.asarray(of["unknowns"].values[: np.argmax(of["h1_bound"].values <= target) + 1])


def beta(infsup: xr.Dataset, smallest_angle: float) -> dict[str, float]:
    """The least beta on adapted meshes with angles of at least so much, and on the others; the least angle.

    Besides these, the largest beta with an edge in each cell, and the least beta_0.
    """
    large = infsup["smallest_angle"] >= smallest_angle
    return {
        "beta": float(infsup["beta_lower"].where(large).min()),
        "flat": float(infsup["beta_upper"].where(~large).min()),
        "angle": float(infsup["smallest_angle"].min()),
        "of_edges": float(infsup["beta_of_edges"].max()),
        "beta_0": float(infsup["beta_0"].min()),
    }
