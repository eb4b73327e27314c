"""The tables in documents about meshes that are graded to a vertex."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd
import xarray as xr

from study.experiments.graded.checks import SMOOTH_ORDER, gamma
from study.experiments.graded.levels import orders_between_levels, rates_by_halving
from study.formats import format_value
from study.tables import error_in_norm

UNKNOWNS_FACTOR = 16
"""Triangles are halved in steps, so orders on adapted meshes are taken over so many times the unknowns."""
GRADED_COLUMNS = {
    r"$\Vert u-u_h\Vert_1$": "h1_error",
    r"$\lambda$ in $H^{-1/2}$": "hm12_error",
    "$D$": "discrete_error",
    "$D$, singular part": "singular_error",
}
ADAPTED_COLUMNS = {
    r"$\Vert u-u_h\Vert_1$": "h1_error",
    "$D$": "discrete_error",
    "shortest edge": "shortest_edge",
}


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """The least beta, angle in degrees and delta of Theorem 5 on graded meshes, and their most unknowns.

    `factor` is that of the unknowns on adapted meshes over which orders are taken.
    """
    errors = results["graded/errors"]
    variables = {"beta": "beta_lower", "angle": "least_angle", "delta": "delta"}
    minima = {name: float(errors[variable].min()) for name, variable in variables.items()}
    return {"graded": minima | {"most_unknowns": float(errors["unknowns"].max()), "factor": UNKNOWNS_FACTOR}}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of orders on graded and on adapted meshes."""
    return {
        "graded": tabulate_graded_orders(results["graded/errors"]),
        "graded-adapted": tabulate_adapted_orders(results["graded/adapted"]),
    }


def tabulate_graded_orders(errors: xr.Dataset) -> pd.DataFrame:
    """The orders in h of the finest pair of levels on which an error is known, by case and kappa."""
    data = errors.assign(hm12_error=error_in_norm(errors, "hm12"))
    rows = []
    for run in range(data.sizes["run"]):
        levels = data.isel(run=run)
        rates = {
            title: float(rates_by_halving(levels[name].dropna("level"))[-1])
            for title, name in GRADED_COLUMNS.items()
        }
        exponent = float(gamma(levels))
        row = {"case": f"`{levels['case'].item()}`", "angle": f"{1 / float(levels['exponent']):.2g}π"}
        row |= {
            r"$\kappa$": f"{float(levels['kappa']):g}",
            r"$\gamma$": f"{exponent:.2f}",
            "required": f"{min(SMOOTH_ORDER, exponent):.2f}",
        }
        rows.append(row | {title: format_value(rate, ".2f") for title, rate in rates.items()})
    return pd.DataFrame(rows)


def tabulate_adapted_orders(adapted: xr.Dataset) -> pd.DataFrame:
    """The least and the largest order in N^{-1/2} on meshes that the bound refines, by case."""
    rows = []
    for case in adapted["case"].values:
        errors = adapted.sel(case=case)
        unknowns = errors["unknowns"].values
        row = {"case": f"`{case}`", "unknowns": format_value(float(errors["unknowns"].max()), "space")}
        for title, name in ADAPTED_COLUMNS.items():
            orders = orders_between_levels(unknowns, errors[name].values, UNKNOWNS_FACTOR)
            smallest_order = format_value(float(orders.min()), ".2f")
            row[title] = (
                f"{smallest_order} to {format_value(float(orders.max()), '.2f')}"
                if len(orders) > 1
                else smallest_order
            )
        rows.append(row)
    return pd.DataFrame(rows)
