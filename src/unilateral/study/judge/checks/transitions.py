"""Checks of Theorem 1 where there are infinitely many transitions: exponents of H at fixed h.

An exponent is the mean of the rates over one period of the set, from each of several sizes of the cells: a
single one depends on where the cells lie.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from unilateral.study.judge.checks.evidence import Evidence, Tables, provided, worst

SHARE = 0.01
"""Of the discretisation error, which the algebraic one may be."""


def exponents(
    tables: Tables, table: str, variable: str, cases: Sequence[str], required: float, at_least: bool
) -> Evidence:
    """Those of something over H, of the cases."""
    data = tables[table]
    found = {case: float(_exponent(data, variable).sel(case=case)) for case in cases}
    quantity = f"the {'smallest' if at_least else 'largest'} exponent of H"
    return provided(worst(found, quantity, required, at_least), _faults(data))


def consistency(tables: Tables, table: str, most: float) -> Evidence:
    """How far the exponent of <Pi_H lambda, u-g> is from sigma + tau, of all cases."""
    data = tables[table]
    distance = abs(_exponent(data, "consistency") - data["flux_order"] - data["gap_order"])
    found = {str(case): float(distance.sel(case=case)) for case in data["case"].values}
    return worst(found, "the distance of its exponent from sigma + tau", most, False)


def beyond_theorem(tables: Tables, table: str, cases: Sequence[str], least: float) -> Evidence:
    """Where the exponent of D lies between (sigma + tau)/2, at 0, and sigma + 1/2, at 1."""
    data = tables[table].sel(case=list(cases))
    proved = (data["flux_order"] + data["gap_order"]) / 2
    place = (_exponent(data, "discrete_error") - proved) / (data["flux_order"] + 0.5 - proved)
    found = {case: float(place.sel(case=case)) for case in cases}
    quantity = "the exponent of D, on the way from (sigma + tau)/2 to sigma + 1/2"
    return provided(worst(found, quantity, least, True), _faults(data))


def _exponent(data: xr.Dataset, variable: str) -> xr.DataArray:
    """Over the cases."""
    coarse, fine = (data.isel(level=k) for k in (0, 1))
    ratios = [xr.DataArray(coarse[name] / fine[name]) for name in (variable, "H")]
    return (xr.apply_ufunc(np.log, ratios[0]) / xr.apply_ufunc(np.log, ratios[1])).mean("start")


def _faults(data: xr.Dataset) -> list[str]:
    """Why errors do not count."""
    share = float((data["algebraic_bound"] / data["discrete_error"]).max())
    unsolved = share > SHARE or not bool((data["converged"] == 1).all())
    return [f"the algebraic error is {share:.2g} of D"] if unsolved else []
