"""Checks of Theorem 1 where there are infinitely many transitions: exponents of H at fixed h.

An exponent is the mean of the rates over one period of the set, from each of several sizes of the cells: a
single one depends on where the cells lie.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from unilateral.study.ledger.evidence import Evidence, Tables, provided, worst

SHARE = 0.01
"""The algebraic error may be at most this share of the discretisation error."""


def exponents(
    tables: Tables, table: str, variable: str, cases: Sequence[str], required: float, at_least: bool
) -> Evidence:
    """The smallest or the largest exponent of a variable over H, of the cases."""
    data = tables[table].sel(case=list(cases))
    quantity = f"the {'smallest' if at_least else 'largest'} exponent of H"
    return provided(worst(exponent(data, variable), quantity, required, at_least), _faults(data))


def consistency(tables: Tables, table: str, most: float) -> Evidence:
    """How far the exponent of <Pi_H lambda, u-g> is from sigma + tau, of all cases."""
    data = tables[table]
    expected = (data["flux_order"] + data["gap_order"]).values
    found = _distance(data, "consistency", expected)
    return worst(found, "the distance of its exponent from sigma + tau", most, False)


def sharp(tables: Tables, table: str, cases: Sequence[str], most: float) -> Evidence:
    """How far the exponent of D is from that of Theorem 1, the smaller of sigma + 1/2 and (sigma + tau)/2."""
    data = tables[table].sel(case=list(cases))
    sigma, tau = data["flux_order"].values, data["gap_order"].values
    found = _distance(data, "discrete_error", np.minimum(sigma + 0.5, (sigma + tau) / 2))
    quantity = "the distance of the exponent of D from that of Theorem 1"
    return provided(worst(found, quantity, most, False), _faults(data))


def attained(tables: Tables, table: str, gamma: float, most: float) -> Evidence:
    """How far rates of D are from (sigma + tau)/2 = (alpha + gamma)/2; each cell has contact and a gap."""
    data = tables[table].sel(gamma=gamma)
    distance = abs(rates(data) - (float(data["alpha"]) + gamma) / 2)
    found = {f"from H = {H:g}": float(each) for H, each in zip(data["H"].values, distance, strict=False)}
    quantity = "the distance of a rate of D from (sigma + tau)/2"
    return provided(worst(found, quantity, most, False), _faults(data))


def beyond_theorem(tables: Tables, table: str, cases: Sequence[str], least: float) -> Evidence:
    """The place of the exponent of D on a scale that is 0 at (sigma + tau)/2 and 1 at sigma + 1/2."""
    data = tables[table].sel(case=list(cases))
    proved, best = (data["flux_order"] + data["gap_order"]).values / 2, data["flux_order"].values + 0.5
    pairs = zip(exponent(data, "discrete_error").items(), proved, best, strict=True)
    found = {case: float((each - low) / (high - low)) for (case, each), low, high in pairs}
    quantity = "the exponent of D, on the way from (sigma + tau)/2 to sigma + 1/2"
    return provided(worst(found, quantity, least, True), _faults(data))


def rates(data: xr.Dataset) -> NDArray[np.float64]:
    """The rates of D between neighbouring partitions."""
    error, H = np.log(data["discrete_error"].values), np.log(data["H"].values)
    return np.diff(error) / np.diff(H)


def exponent(data: xr.Dataset, variable: str) -> dict[str, float]:
    """The exponent of a variable over H by case, the mean over the starts."""
    values, sizes = (np.diff(np.log(data[name].values)) for name in (variable, "H"))
    means = (values / sizes).mean(axis=(1, 2)).tolist()
    return dict(zip(data["case"].values.tolist(), means, strict=True))


def _distance(data: xr.Dataset, variable: str, expected: NDArray[np.float64]) -> dict[str, float]:
    pairs = zip(exponent(data, variable).items(), expected, strict=True)
    return {case: abs(found - float(each)) for (case, found), each in pairs}


def _faults(data: xr.Dataset) -> list[str]:
    """Why errors do not count; empty if they do."""
    share = float((data["algebraic_bound"] / data["discrete_error"]).max())
    unsolved = share > SHARE or not bool((data["converged"] == 1).all())
    return [f"the algebraic error is {share:.2g} of D"] if unsolved else []
