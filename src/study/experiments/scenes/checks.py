"""Checks of the rates of the cases' errors, as they were judged, and of how fast bounds become exact."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import xarray as xr

from study.evidence import (
    MAX_ALGEBRAIC_SHARE,
    Evidence,
    Tables,
    Unjudged,
    pick_worst,
    require_preconditions,
    select_cases,
)
from study.rates import MIN_PAIRS, smallest_rate
from unilateral.arrays import Array


def theorem_rate(
    tables: Tables, scenes: Sequence[str], cases: Sequence[str], norm: str, H_over_h: float, tolerance: float
) -> Evidence:
    """The smallest asymptotic rate of the cases, against what the theorem proves less a tolerance.

    Raises Unjudged if it is reached, but some rate is not judged to hold.
    """
    judged = _select_judged_rates(tables, scenes, cases, [norm], H_over_h)
    rows = {name: row for name, row in judged.items() if row["verdict"].item() != "exact"}
    if not rows:
        raise Unjudged("there is no rate: all errors are 0")
    smallest = {name: smallest_rate(row) for name, row in rows.items()}
    proved = max(float(row["proved"]) for row in rows.values())
    return require_preconditions(
        pick_worst(smallest, "the smallest rate", proved - tolerance, True), _rate_faults(rows)
    )


def not_faster(
    tables: Tables, scenes: Sequence[str], cases: Sequence[str], norm: str, H_over_h: float, at_most: float
) -> Evidence:
    """The largest rate of the finest pair of levels."""
    finest_rates = {
        name: _finest_rate(row)
        for name, row in _select_judged_rates(tables, scenes, cases, [norm], H_over_h).items()
    }
    return pick_worst(finest_rates, "the largest rate of the finest pair", at_most, False)


def _finest_rate(row: xr.Dataset) -> float:
    """The rate of the finest pair."""
    rates = row["rate"].values
    return float(rates[np.isfinite(rates)][-1])


def _select_judged_rates(
    tables: Tables, scenes: Sequence[str], cases: Sequence[str], norms: Iterable[str], H_over_h: float
) -> dict[str, xr.Dataset]:
    """The rows of the tables of rates, by scene, case and norm."""
    return {
        f"{name}, {norm}": rates.sel(h_over_H=1 / H_over_h, norm=norm)
        for name, rates in select_cases(tables, "{scene}/rates", scenes, cases).items()
        for norm in norms
    }


def _rate_faults(rows: Mapping[str, xr.Dataset]) -> list[str]:
    """The reasons why rates are not judged to hold."""
    return [
        f"{name}: {row['why'].item() or row['verdict'].item()}"
        for name, row in rows.items()
        if row["verdict"].item() != "holds"
    ]


def rate_excess(
    tables: Tables,
    scenes: Sequence[str],
    cases: Sequence[str],
    H_over_h: float,
    tolerances: Mapping[str, float],
) -> Evidence:
    """The least excess of the observed rates over the expected ones, as a multiple of its norm's tolerance.

    Raises Unjudged if none is below 0, but a rate is judged to fail, or cannot be judged.
    """
    judged = _select_judged_rates(tables, scenes, cases, tolerances, H_over_h)
    rows = {
        name: row
        for name, row in judged.items()
        if row["verdict"].item() in ("holds", "fails") or row["why"].item()
    }
    excess = {
        name: (smallest_rate(row) - float(row["expected"])) / tolerances[row["norm"].item()]
        for name, row in rows.items()
    }
    quantity = "the smallest rate less the expected one, over its tolerance"
    return require_preconditions(pick_worst(excess, quantity, -1.0, True), _rate_faults(rows))


def finest_rate_excess(
    tables: Tables,
    scenes: Sequence[str],
    cases: Sequence[str],
    H_over_h: float,
    tolerances: Mapping[str, float],
) -> Evidence:
    """The largest excess of the finest pair's rates over the expected ones, in tolerances of its norm."""
    excess = {
        name: (_finest_rate(row) - float(row["expected"])) / tolerances[row["norm"].item()]
        for name, row in _select_judged_rates(tables, scenes, cases, tolerances, H_over_h).items()
    }
    quantity = "the rate of the finest pair less the expected one, over its tolerance"
    return pick_worst(excess, quantity, 1.0, False)


def regularity_rate(
    tables: Tables,
    scenes: Sequence[str],
    orders: Mapping[str, float],
    H_over_h: float,
    tolerances: Mapping[str, float],
) -> Evidence:
    """The least excess of the rates of cases over the s of u in H^{1+s}, in tolerances of its norm."""
    rows = _select_judged_rates(tables, scenes, list(orders), tolerances, H_over_h)
    excess = {
        name: (smallest_rate(row) - orders[row["case"].item()]) / tolerances[row["norm"].item()]
        for name, row in rows.items()
    }
    quantity = "the smallest rate less $s$, over its tolerance"
    return require_preconditions(pick_worst(excess, quantity, -1.0, True), _rate_faults(rows))


def l2_order(
    tables: Tables, scenes: Sequence[str], orders: Mapping[str, float], H_over_h: float, tolerance: float
) -> Evidence:
    """The least excess of the rates of ||u - u_h||_0 over the proved orders of cases, in tolerances.

    Rates are those of `asymptotic_l2_rates`. Raises Unjudged if none is too low, but a case is in no scene or
    has too few pairs of levels, or an algebraic error is not small.
    """
    errors = select_cases(tables, "{scene}/u_in_l2", scenes, orders)
    judged = select_cases(tables, "{scene}/rates", scenes, orders)
    smallest = {}
    faults = [f"{case} is in no scene" for case in list_absent_cases(errors.values(), orders)]
    for name, run in errors.items():
        rates = asymptotic_l2_rates(run, judged[name], H_over_h)
        smallest[name] = float(np.min(rates, initial=np.inf))
        if len(rates) < MIN_PAIRS:
            faults.append(f"{name}: there are fewer than {MIN_PAIRS} pairs of asymptotic levels")
        if not np.all(run["algebraic_bound"] <= MAX_ALGEBRAIC_SHARE * run["u_l2_error"]):
            faults.append(f"{name}: a guaranteed algebraic error is not small")
    excess = {
        name: (rate - orders[errors[name]["case"].item()]) / tolerance for name, rate in smallest.items()
    }
    quantity = "the smallest rate less the proved order, over its tolerance"
    return require_preconditions(pick_worst(excess, quantity, -1.0, True), faults)


def l2_order_in_full_contact(
    tables: Tables, scenes: Sequence[str], orders: Mapping[str, float], H_over_h: float, tolerance: float
) -> Evidence:
    """The evidence of `l2_order`. Raises Unjudged if it holds, but lambda_H is 0 in a cell of some level."""
    errors = select_cases(tables, "{scene}/u_in_l2", scenes, orders)
    released = [
        f"{name}: a multiplier is 0"
        for name, run in errors.items()
        if not (run["least_multiplier"] > 0).all()
    ]
    return require_preconditions(l2_order(tables, scenes, orders, H_over_h, tolerance), released)


def asymptotic_l2_rates(errors: xr.Dataset, rates: xr.Dataset, H_over_h: float) -> Array:
    """Rates (p,) of a case's errors ||u - u_h||_0, between levels that are asymptotic in H^{-1/2}.

    These are the levels for D, the part of the bound that is of lower order.
    """
    dual = rates.sel(norm="hm12", h_over_H=1 / H_over_h)
    is_asymptotic = dual["asymptotic"].values == 1
    h_coarse = dual["h_coarse"].values[is_asymptotic]
    h_fine = dual["h_fine"].values[is_asymptotic]
    error = errors["u_l2_error"].swap_dims(mesh="h")
    coarse = error.sel(h=h_coarse, method="nearest").values
    fine = error.sel(h=h_fine, method="nearest").values
    # log(e_1 / e_2) / log(h_1 / h_2)
    return np.asarray(np.log(coarse / fine) / np.log(h_coarse / h_fine))


def list_absent_cases(runs: Iterable[xr.Dataset], cases: Iterable[str]) -> list[str]:
    """The cases, sorted, of which there is no run."""
    return sorted(set(cases) - {run["case"].item() for run in runs})


def exactness(
    tables: Tables, scenes: Sequence[str], orders: Mapping[str, float], tolerance: float
) -> Evidence:
    """The least excess of the rates of index - 1 over those of Proposition S20, in tolerances.

    Of cases with the order p the expected rate is 2 (p - 1), or the tolerance if that is larger: a rate may
    fall short by the tolerance, but not below 0. Raises Unjudged if a case is in no scene.
    """
    rows = select_cases(tables, "{scene}/totals", scenes, orders)
    expected = {
        name: max(2 * (orders[totals["case"].item()] - 1), tolerance) for name, totals in rows.items()
    }
    excess = {name: (float(index_rate(totals)) - expected[name]) / tolerance for name, totals in rows.items()}
    quantity = "the smallest rate of index − 1 less the expected one, over its tolerance"
    evidence = pick_worst(excess, quantity, -1.0, True)
    absent = list_absent_cases(rows.values(), orders)
    return require_preconditions(evidence, [f"{case} is in no scene" for case in absent])


def index_rate(totals: xr.Dataset) -> xr.DataArray:
    """The rate at which the sharp bound over the error of u, less 1, falls on the last two halvings of h."""
    excess = totals["total_index_u"].isel(mesh=[-3, -1]) - 1
    h = totals["h"].isel(mesh=[-3, -1])
    # log(excess_1 / excess_2) / log(h_1 / h_2)
    excess_fall = xr.DataArray(np.log(excess.isel(mesh=0) / excess.isel(mesh=1)))
    h_fall = xr.DataArray(np.log(h.isel(mesh=0) / h.isel(mesh=1)))
    return excess_fall / h_fall
