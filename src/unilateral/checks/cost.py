"""Checks of what accuracy costs: the growth of the steps, the stop that is enough, the price of a step."""

from __future__ import annotations

import numpy as np

from unilateral import trade
from unilateral.checks.found import Found, Tables, worst


def growth(tables: Tables, algorithm: str, H_over_h: float, coarsest: float, most: float) -> Found:
    """The exponent p of steps ~ H^-p, see `trade.growth`."""
    found = trade.growth(tables["cost/algorithm"], algorithm, H_over_h, coarsest)
    return worst({algorithm: found}, "the exponent p of steps ~ H^(-p)", most, False)


def exponent(
    tables: Tables, algorithm: str, H_over_h: float, coarsest: float, expected: float, tolerance: float
) -> Found:
    """Its distance from the expected one."""
    p = trade.growth(tables["cost/algorithm"], algorithm, H_over_h, coarsest)
    quantity = f"the distance of p from {expected:g}, steps ~ H^(-p)"
    return worst({f"{algorithm}, p = {p:.3g}": abs(p - expected)}, quantity, tolerance, False)


def safe_step(tables: Tables, most: float) -> Found:
    """Steps but one with rho = 1.9 sigma_1 over those with the optimal one, at all levels; inf if not met."""
    steps = tables["cost/algorithm"]["steps"]
    rows = {}
    for ratio in steps["H_over_h"].values:
        safe, optimal = (steps.sel(H_over_h=ratio, algorithm=name) for name in ("safe", "optimal"))
        ran = np.isfinite(optimal) & (optimal > 0)
        rows[f"H/h = {ratio:g}"] = float(((safe.fillna(np.inf) - 1) / optimal).where(ran).max())
    quantity = "steps but one with rho = 1.9 sigma_1 over those with 2/(lambda_min + lambda_max)"
    return worst(rows, quantity, most, False)


def stop_is_enough(tables: Tables, norm: str, stop: float, coarsest: float, most: float) -> Found:
    """The error at a level over that of the discrete solution, the largest of every case."""
    cases = tables["cost/case"]
    of = trade.excess(cases.sel(H=cases["H"] <= coarsest), norm).sel(stop=stop).max("H", skipna=False)
    rows = {str(name): float(of.sel(case=name)) for name in of["case"].values}
    return worst(rows, f"error at the level {stop:g} over that of the discrete solution", most, False)


def stop_is_not_enough(tables: Tables, case: str, stop: float, coarsest: float, least: float) -> Found:
    """In H^{-1/2} the lower bound of the error at a level over the upper bound of the discrete solution's."""
    table = tables["cost/case"].sel(case=case)
    fine = table.sel(H=table["H"] <= coarsest)
    share = fine["hm12_error_lower"].sel(stop=stop) / fine["hm12_discrete_upper"]
    rows = {f"{case}, H = {H:g}": float(each) for H, each in zip(fine["H"].values, share, strict=True)}
    return worst(rows, f"error at the level {stop:g} over that of the discrete solution", least, True)


def economy(tables: Tables, coarsest: float, least: float) -> Found:
    """Operations of a step with A factorised over those with S; 0 unless both take the same steps."""
    algebra = tables["cost/algebra"]
    fine = algebra.sel(H=algebra["H"] <= coarsest)
    share = fine["step_operations"].sel(algebra="A") / fine["step_operations"].sel(algebra="S")
    rows = {f"h = {h:g}": float(each) for h, each in zip(fine["h"].sel(algebra="S"), share, strict=True)}
    found = worst(rows, "operations of a step with A over those with S", least, True)
    with_A, with_S = (algebra["steps"].sel(algebra=name) for name in ("A", "S"))
    both = np.isfinite(with_A)
    same = bool(both.any()) and bool((with_A == with_S).where(both, True).all())
    return found if same else found._replace(observed=0.0)
