"""Checks of Theorem 1 where there are infinitely many transitions: exponents of H at fixed h.

An exponent is the mean of the rates over one period of the set, from each of several sizes of the cells: a
single one depends on where the cells lie.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from study.evidence import (
    MAX_ALGEBRAIC_SHARE,
    Evidence,
    Tables,
    name_values,
    pick_worst,
    require_preconditions,
)


def exponents(
    tables: Tables, table: str, variable: str, cases: Sequence[str], required: float, is_minimum: bool
) -> Evidence:
    """The smallest or the largest exponent of a variable over H, of the cases."""
    data = tables[table].sel(case=list(cases))
    quantity = f"the {'smallest' if is_minimum else 'largest'} exponent of $H$"
    named = name_values(period_exponent(data, variable), "{case}")
    return require_preconditions(pick_worst(named, quantity, required, is_minimum), _algebraic_faults(data))


def consistency(tables: Tables, table: str, at_most: float) -> Evidence:
    """How far the exponent of <Pi_H lambda, u-g> is from sigma + tau, of all cases."""
    data = tables[table]
    distance = abs(period_exponent(data, "consistency") - (data["flux_order"] + data["gap_order"]))
    return pick_worst(
        name_values(distance, "{case}"), r"the distance of its exponent from $\sigma + \tau$", at_most, False
    )


def theorem_1_sharpness(tables: Tables, table: str, cases: Sequence[str], at_most: float) -> Evidence:
    """How far the exponent of D is from that of Theorem 1, the smaller of sigma + 1/2 and (sigma + tau)/2."""
    data = tables[table].sel(case=list(cases))
    sigma = data["flux_order"]
    tau = data["gap_order"]
    # Theorem 1: D ~ H^{min(sigma + 1/2, (sigma + tau)/2)}
    distance = abs(period_exponent(data, "discrete_error") - np.minimum(sigma + 0.5, (sigma + tau) / 2))
    quantity = "the distance of the exponent of $D$ from that of Theorem 1"
    return require_preconditions(
        pick_worst(name_values(distance, "{case}"), quantity, at_most, False), _algebraic_faults(data)
    )


def alternating_rates(tables: Tables, table: str, gamma: float, at_most: float) -> Evidence:
    """How far rates of D are from (sigma + tau)/2 = (alpha + gamma)/2; each cell has contact and a gap."""
    data = tables[table].sel(gamma=gamma)
    named = name_values(abs(partition_rates(data) - (float(data["alpha"]) + gamma) / 2), "from H = {H:g}")
    quantity = r"the distance of a rate of $D$ from $(\sigma + \tau)/2$"
    return require_preconditions(pick_worst(named, quantity, at_most, False), _algebraic_faults(data))


def beyond_theorem(tables: Tables, table: str, cases: Sequence[str], at_least: float) -> Evidence:
    """The place of the exponent of D on a scale that is 0 at (sigma + tau)/2 and 1 at sigma + 1/2."""
    data = tables[table].sel(case=list(cases))
    proved = (data["flux_order"] + data["gap_order"]) / 2
    best = data["flux_order"] + 0.5
    named = name_values((period_exponent(data, "discrete_error") - proved) / (best - proved), "{case}")
    quantity = r"the exponent of $D$, on the way from $(\sigma + \tau)/2$ to $\sigma + 1/2$"
    return require_preconditions(pick_worst(named, quantity, at_least, True), _algebraic_faults(data))


def partition_rates(data: xr.Dataset) -> xr.DataArray:
    """The rates of D from each partition to the next finer one."""
    error = xr.ufuncs.log(data["discrete_error"])
    H = xr.ufuncs.log(data["H"])
    return error.diff("partition", label="lower") / H.diff("partition", label="lower")


def period_exponent(data: xr.Dataset, variable: str) -> xr.DataArray:
    """The exponent of a variable over H by case, the mean over the starts."""
    # log(v_1 / v_2) / log(H_1 / H_2) over one period, from each start
    values = xr.ufuncs.log(data[variable]).diff("level")
    sizes = xr.ufuncs.log(data["H"]).diff("level")
    return (values / sizes).mean(["start", "level"], skipna=False)


def _algebraic_faults(data: xr.Dataset) -> list[str]:
    """Why errors do not count; empty if they do."""
    share = float((data["algebraic_bound"] / data["discrete_error"]).max())
    unsolved = share > MAX_ALGEBRAIC_SHARE or not bool((data["converged"] == 1).all())
    return [f"the algebraic error is {share:.2g} of D"] if unsolved else []
