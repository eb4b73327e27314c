"""The numbers in documents about adapted meshes beside uniform ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from study.formats import DASH, format_value
from study.scenes import has_clamped_sides
from unilateral.norms.resolution import RULE

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
    """The least beta and angle on adapted meshes, as documents name them."""
    return {
        "adapted": summarise_adapted_beta(
            split_by_clamping(results["adaptive/infsup"])[0], RULE.smallest_angle
        )
    }


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of adapted meshes: finest levels, savings, and problems with clamped sides."""
    measured, clamped = split_by_clamping(results["adaptive/errors"].merge(results["adaptive/rates"]))
    return {
        "adapted": tabulate_finest_levels(measured),
        "adapted-savings": tabulate_savings(measured),
        "adapted-clamped": tabulate_finest_levels(clamped),
    }


def split_by_clamping(table: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """The problems without clamped sides, and those with some."""
    clamped = np.array([has_clamped_sides(name) for name in table["case"].values])
    return table.isel(case=~clamped), table.isel(case=clamped)


def tabulate_finest_levels(table: xr.Dataset) -> pd.DataFrame:
    """The finest level of each kind of mesh, by problem, and the rates on the finest pair."""
    rows = []
    for case in table["case"].values:
        for kind in table["kind"].values:
            levels = table.sel(case=case, kind=kind).dropna("level", subset=["unknowns"])
            row = {"problem": f"`{case}`", "meshes": str(kind)}
            for title, (name, spec) in COLUMNS.items():
                last = _last_value(levels[name])
                row[title] = format_value(last, spec) if np.isfinite(last) else DASH
            rows.append(row)
    return pd.DataFrame(rows)


def _last_value(values: xr.DataArray) -> float:
    """The last value that is known, or NaN."""
    finite = values.dropna("level").values
    return float(finite[-1]) if len(finite) else np.nan


def tabulate_savings(errors: xr.Dataset) -> pd.DataFrame:
    """How many unknowns adapted meshes save for the bound of the finest uniform mesh, by problem.

    These are the unknowns of the first mesh of each kind with that bound, and the quotients, uniform over
    adapted, of these meshes and of all levels up to them.
    """
    rows = []
    for case in errors["case"].values:
        case_levels = errors.sel(case=case)
        target = _last_value(case_levels["h1_bound"].sel(kind="uniform"))
        uniform = _unknowns_to_bound(case_levels.sel(kind="uniform"), target)
        adapted = _unknowns_to_bound(case_levels.sel(kind="adapted"), target)
        rows.append(
            {
                "problem": f"`{case}`",
                "bound": format_value(target, "up.short"),
                "uniform": format_value(uniform[-1], "space"),
                "adapted": format_value(adapted[-1], "space"),
                "fewer": format_value(uniform[-1] / adapted[-1], ".1f"),
                "of all levels": format_value(uniform.sum() / adapted.sum(), ".1f"),
            }
        )
    return pd.DataFrame(rows)


def _unknowns_to_bound(levels: xr.Dataset, target: float) -> NDArray[np.float64]:
    """The unknowns of the levels up to the first with that bound."""
    return np.asarray(levels["unknowns"].values[: np.argmax(levels["h1_bound"].values <= target) + 1])


def summarise_adapted_beta(infsup: xr.Dataset, smallest_angle: float) -> dict[str, float]:
    """The least beta on adapted meshes with angles of at least so much, and on the others; the least angle.

    Besides these, the largest beta with an edge in each cell, the least beta_0, the shortest cell, and in how
    many steps Uzawa's algorithm gains a factor of e at best. |1 - rho lambda_min| >= 1 - x with x = 2/cond(S)
    for every rho < 2/lambda_max, and -1/log(1 - x) >= 1/x - 1.
    """
    condition = infsup["lambda_max"] / infsup["lambda_min"]
    large = infsup["smallest_angle"] >= smallest_angle
    return {
        "beta": float(infsup["beta_lower"].where(large).min()),
        "flat": float(infsup["beta_upper"].where(~large).min()),
        "angle": float(infsup["smallest_angle"].min()),
        "of_edges": float(infsup["beta_of_edges"].max()),
        "beta_0": float(infsup["beta_0"].min()),
        "shortest_cell": float(infsup["shortest_cell"].min()),
        "steps": 0.5 * float(condition.max()) - 1,
    }
