"""Checks of the orders on graded meshes, against min(3/2, gamma) with gamma = pi/(omega kappa)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from study.evidence import Evidence, Tables, provided, worst
from study.experiments.graded.levels import halved
from study.tables import error_in

SMOOTH = 1.5
"""The order of P0 on cells that are of the size H at most, for a lambda that is smooth on every side."""
PAIRS = 2
"""A run with fewer pairs of levels is not judged."""
SHARE = 0.01
"""The algebraic error may be at most this share of the error that is judged."""


def order(tables: Tables, table: str, norms: Sequence[str], tolerance: float) -> Evidence:
    """The least excess over min(3/2, gamma) of the rates in each norm, on all pairs of levels.

    Raises Unjudged if it would pass, but the algebraic error counts, or a run has too few pairs.
    """
    data = tables[table]
    faults = list[str]()
    found: dict[str, float] = {}
    share = float((data["algebraic_bound"] / data["discrete_error"]).max())
    if not share <= SHARE:
        faults.append(f"the algebraic error is {share:.2g} of D")
    for norm in norms:
        rates = halved(error_in(data, norm))
        pairs = int(rates.count("pair").min())
        if pairs < PAIRS:
            faults.append(f"a run has {pairs} pairs")
        found |= _by_run((rates - expected(data)).min("pair"), data, f"{norm}, ")
    return provided(worst(found, r"the smallest rate less $\min(3/2, \gamma)$", -tolerance, True), faults)


def attained(tables: Tables, table: str, tolerance: float) -> Evidence:
    """The largest excess over gamma of the rates of u's singular part, on the finest pair, for gamma < 3/2.

    Raises Unjudged if it would pass, but some lambda_H is 0: then the problem is not linear.
    """
    data = tables[table]
    slow = data.isel(run=np.flatnonzero(gamma(data) < SMOOTH))
    excess = halved(slow["singular_error"]).isel(pair=-1) - gamma(slow)
    least = float(data["least_multiplier"].min())
    faults = [] if least > 0 else [f"lambda_H is {least:.2g} in a cell"]
    quantity = r"the rate of the finest pair less $\gamma$"
    return provided(worst(_by_run(excess, slow), quantity, tolerance, False), faults)


def superclose(tables: Tables, table: str, tolerance: float) -> Evidence:
    """The least excess of the rates of t over min(3/2, gamma), on the two finest pairs.

    Where gamma > 3/2 the factor (1 + ln 1/h)^{1/2} is allowed for.
    """
    data = tables[table]
    taken = 0.5 * halved(1 / (1 - xr.ufuncs.log(data["equal_h"]))) * (gamma(data) > SMOOTH)
    excess = halved(data["weighted_ritz_means"]) + taken - expected(data)
    least = excess.isel(pair=[-2, -1]).min("pair", skipna=False)
    quantity = r"the smallest rate of $t$ with its logarithm, less $\min(3/2, \gamma)$"
    return worst(_by_run(least, data), quantity, -tolerance, True)


def gamma(data: xr.Dataset) -> xr.DataArray:
    """pi/(omega kappa) by run."""
    return data["exponent"] / data["kappa"]


def expected(data: xr.Dataset) -> xr.DataArray:
    return gamma(data).clip(max=SMOOTH)


def _by_run(values: xr.DataArray, data: xr.Dataset, before: str = "") -> dict[str, float]:
    names = [
        f"{before}{case}, kappa = {kappa:g}"
        for case, kappa in zip(data["case"].values, data["kappa"].values, strict=True)
    ]
    return dict(zip(names, map(float, values.values), strict=True))
