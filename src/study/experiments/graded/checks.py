"""Checks of the orders on graded meshes, against min(3/2, gamma) with gamma = pi/(omega kappa)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from study.evidence import MAX_ALGEBRAIC_SHARE, Evidence, Tables, pick_worst, require_preconditions
from study.experiments.graded.levels import rates_by_halving
from study.tables import error_in_norm

SMOOTH_ORDER = 1.5
"""The order of P0 on cells that are of the size H at most, for a lambda that is smooth on every side."""
MIN_GRADED_PAIRS = 2
"""A run with fewer pairs of levels is not judged."""


def order(tables: Tables, table: str, norms: Sequence[str], tolerance: float) -> Evidence:
    """The least excess over min(3/2, gamma) of the rates in each norm, on all pairs of levels.

    Raises Unjudged if it would pass, but the algebraic error counts, or a run has too few pairs.
    """
    data = tables[table]
    faults = list[str]()
    excess: dict[str, float] = {}
    share = float((data["algebraic_bound"] / data["discrete_error"]).max())
    if not share <= MAX_ALGEBRAIC_SHARE:
        faults.append(f"the algebraic error is {share:.2g} of D")
    for norm in norms:
        rates = rates_by_halving(error_in_norm(data, norm))
        pairs = int(rates.count("pair").min())
        if pairs < MIN_GRADED_PAIRS:
            faults.append(f"a run has {pairs} pairs")
        excess |= _name_by_run((rates - expected_order(data)).min("pair"), data, f"{norm}, ")
    return require_preconditions(
        pick_worst(excess, r"the smallest rate less $\min(3/2, \gamma)$", -tolerance, True), faults
    )


def singular_order(tables: Tables, table: str, tolerance: float) -> Evidence:
    """The largest excess over gamma of the rates of u's singular part, on the finest pair, for gamma < 3/2.

    Raises Unjudged if it would pass, but some lambda_H is 0: then the problem is not linear.
    """
    data = tables[table]
    slow = data.isel(run=np.flatnonzero(gamma(data) < SMOOTH_ORDER))
    excess = rates_by_halving(slow["singular_error"]).isel(pair=-1) - gamma(slow)
    smallest_multiplier = float(data["least_multiplier"].min())
    faults = [] if smallest_multiplier > 0 else [f"lambda_H is {smallest_multiplier:.2g} in a cell"]
    quantity = r"the rate of the finest pair less $\gamma$"
    return require_preconditions(pick_worst(_name_by_run(excess, slow), quantity, tolerance, False), faults)


def t_order(tables: Tables, table: str, tolerance: float) -> Evidence:
    """The least excess of the rates of t over min(3/2, gamma), on the two finest pairs.

    Where gamma > 3/2 the factor (1 + ln 1/h)^{1/2} is allowed for.
    """
    data = tables[table]
    # t <= C h^{3/2} (1 + ln 1/h)^{1/2} for gamma > 3/2: the rate that the root of the logarithm takes
    log_rate = 0.5 * rates_by_halving(1 / (1 - xr.ufuncs.log(data["equal_h"]))) * (gamma(data) > SMOOTH_ORDER)
    excess = rates_by_halving(data["weighted_ritz_means"]) + log_rate - expected_order(data)
    smallest_excess = excess.isel(pair=[-2, -1]).min("pair", skipna=False)
    quantity = r"the smallest rate of $t$ with its logarithm, less $\min(3/2, \gamma)$"
    return pick_worst(_name_by_run(smallest_excess, data), quantity, -tolerance, True)


def gamma(data: xr.Dataset) -> xr.DataArray:
    """pi/(omega kappa) by run."""
    return data["exponent"] / data["kappa"]


def expected_order(data: xr.Dataset) -> xr.DataArray:
    """The order min(3/2, gamma) by run."""
    return gamma(data).clip(max=SMOOTH_ORDER)


def _name_by_run(values: xr.DataArray, data: xr.Dataset, prefix: str = "") -> dict[str, float]:
    names = [
        f"{prefix}{case}, kappa = {kappa:g}"
        for case, kappa in zip(data["case"].values, data["kappa"].values, strict=True)
    ]
    return dict(zip(names, map(float, values.values), strict=True))
