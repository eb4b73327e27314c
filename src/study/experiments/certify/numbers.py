"""Bounds over errors of solutions of other methods, as documents show them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd
import xarray as xr

from study.formats import format_value


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """The bound over the error at the first penalty, on the coarsest and the finest mesh; the sweeps.

    `half` is the error with half the load over that of the mixed method, for `clamped` on the coarsest mesh.
    """
    index = bound_indices(results["certify/solutions"]).sel(case="natural")
    penalty_indices = index.sel(scheme=f"penalty {study['certify']['penalties'][0]}/h").values
    errors = results["certify/solutions"]["certified_error"].sel(case="clamped").isel(mesh=0)
    half = float(errors.sel(scheme="half the load") / errors.sel(scheme="mixed method"))
    penalty = {"coarsest": float(penalty_indices[0]), "finest": float(penalty_indices[-1])}
    return {"certify": {"penalty": penalty, "half": half, "sweeps": study["certify"]["sweeps"]}}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The table of bounds over errors for other methods' solutions."""
    return {"certify": tabulate_solutions(results["certify/solutions"])}


def bound_indices(table: xr.Dataset) -> xr.DataArray:
    """The bounds over the errors."""
    return table["certified_bound"] / table["certified_error"]


def tabulate_solutions(table: xr.Dataset) -> pd.DataFrame:
    """The true error and the bound over it, a row per case and method."""
    rows = []
    for case in table["case"].values:
        for scheme in table["scheme"].values:
            row = {"case": f"`{case}`", "method": str(scheme)}
            runs = table.sel(case=case, scheme=scheme)
            for k, h in enumerate(table["h"].values):
                size = f"h = {format_value(float(h), '1/n')}"
                row[f"error, {size}"] = f"{float(runs['certified_error'][k]):.3g}"
                row[f"bound/error, {size}"] = f"{float(bound_indices(runs)[k]):.2f}"
            rows.append(row)
    return pd.DataFrame(rows)
