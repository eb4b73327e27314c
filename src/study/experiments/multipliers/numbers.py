"""Errors of lambda by several methods, as documents show them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd
import xarray as xr

from study import tables

NAMED_SCHEMES = {
    "nodal": "nodal reactions",
    "stabilised": "stabilised, H = h",
    "linear": "P0, H = 2h, linear",
    "nodal_linear": "nodal reactions, linear",
}
"""The methods whose errors documents name."""
RATED_LEVELS = 2
"""Rates are over so many halvings of h: then the transitions of `thirds` lie in their cells as before."""


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """Finest errors in H^(-1/2) over those of lambda_H with H = 2h, and the factor of the stabilisation.

    `continuous` is the largest of the cases whose lambda is continuous, `jump` that of `natural`, whose
    lambda jumps at the vertices. `same_number` compares the stabilised multiplier with lambda_H on a mesh of
    half the size, where both have equally many multipliers: the least and the largest of the cases.
    """
    errors = results["multipliers/errors"]
    dual = _relative_errors(errors, "hm12")
    continuous = dual.sel(case=["thirds", "smooth"]).max("case")
    jumping = dual.sel(case="natural")
    groups = {
        name: {"continuous": float(continuous.sel(scheme=scheme)), "jump": float(jumping.sel(scheme=scheme))}
        for name, scheme in NAMED_SCHEMES.items()
    }
    error = tables.error_in_norm(errors, "hm12")
    coarser = error.sel(scheme="stabilised, H = h").isel(mesh=-2)
    same_number = coarser / error.sel(scheme="P0, H = 2h").isel(mesh=-1)
    groups["same_number"] = {"least": float(same_number.min()), "largest": float(same_number.max())}
    return {"multipliers": groups | {"gamma": study["multipliers"]["stabilisation"]}}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The table of rates and finest errors."""
    return {"multipliers": tabulate_errors(results["multipliers/errors"])}


def tabulate_errors(errors: xr.Dataset) -> pd.DataFrame:
    """A row per case and method: multipliers on the finest mesh, rates, and errors over those at H = 2h."""
    heads = {"hm12": r"$H^{-1/2}$", "l2": r"$L^2$"}
    rows = []
    for case in errors["case"].values:
        for scheme in errors["scheme"].values:
            runs = errors.sel(case=case, scheme=scheme)
            row = {"case": f"`{case}`", "multiplier": str(scheme)}
            row["number"] = f"{int(runs['multipliers'][-1])}"
            for norm, head in heads.items():
                error = tables.error_in_norm(runs, norm).values
                fall = math.log(error[-1 - RATED_LEVELS] / error[-1])
                rate = fall / math.log(float(runs["h"][-1 - RATED_LEVELS] / runs["h"][-1]))
                relative = float(_relative_errors(errors, norm).sel(case=case, scheme=scheme))
                row[f"rate, {head}"] = f"{rate:.2f}"
                row[f"error, {head}"] = f"{relative:.2f}"
            rows.append(row)
    return pd.DataFrame(rows)


def _relative_errors(errors: xr.Dataset, norm: str) -> xr.DataArray:
    """The finest errors over those of lambda_H with H = 2h."""
    finest = tables.error_in_norm(errors, norm).isel(mesh=-1)
    return finest / finest.sel(scheme="P0, H = 2h")
