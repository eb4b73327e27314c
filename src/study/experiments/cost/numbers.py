"""What the study of cost recommends, and what that is worth, as documents name it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study.experiments.cost import tables, trade
from study.experiments.cost.variants import REFRESH
from unilateral.formulas.formula import real

READS = {
    "algorithm": "results/cost/algorithm.nc",
    "case": "results/cost/case.nc",
    "scene": "results/cost/scene.nc",
    "algebra": "results/cost/algebra.nc",
    "precision": "results/cost/precision.nc",
}
"""The files behind the numbers and tables of this experiment in documents, by name."""
LARGEST_RATIO = 4.0
"""The growth of steps is found for H/h up to this number, for which there are enough sizes."""


def numbers(of: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    H_over_h, coarsest = _base(study)
    return {
        "cost": recommended(of["case"], H_over_h, coarsest)
        | {
            "enough_times": trade.ENOUGH,
            "newton_adds": newton_adds(of["algorithm"], H_over_h),
            "plain": plain(of["algorithm"], H_over_h),
            "growth": growth(of["algorithm"], coarsest),
            "elimination": elimination(of["algorithm"], of["algebra"], H_over_h),
            "precision": in_precision(of["precision"]),
        }
    }


def blocks(of: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    H_over_h, coarsest = _base(study)
    return {
        "ratios": tables.ratios(of["case"], coarsest),
        "prices": tables.price_table(of["case"], of["scene"], H_over_h, coarsest),
        "expected": tables.expected(of["case"], H_over_h, coarsest),
        "algorithms": tables.algorithms(of["algorithm"], H_over_h),
        "targets": tables.targets(of["algorithm"], study["cost"]["targets"]),
    }


def _base(study: Mapping[str, Any]) -> tuple[float, float]:
    """H/h of the runs that are recommended, and the largest H of fits."""
    cost = study["cost"]
    return real(cost["base"]["H_over_h"], "cost.base.H_over_h"), real(cost["fitted_from"], "cost.fitted_from")


def recommended(cases: xr.Dataset, H_over_h: float, coarsest: float) -> dict[str, Any]:
    """Over all cases: the loss against the best H/h, that H/h, the stop that `natural` needs, the work that
    Uzawa adds to the set-up, and the factor of work for half the error.
    """
    lost, both = tables.losses(cases, coarsest), ("h1", "hm12")
    of = tables.prices(tables.by_case(cases), H_over_h, coarsest)
    added = [price.over_setup - 1 for price in of["h1"].values()]
    return {
        "cases": cases.sizes["case"],
        "compared_at": trade.SHOWN,
        "lowest": float(cases["stop"].min()),
        "loss": {norm: {work: by[H_over_h][1] - 1 for work, by in lost[norm].items()} for norm in both},
        "best_ratio": {n: {work: tables.best_ratio(by) for work, by in lost[n].items()} for n in lost},
        "enough": {"hm12": {"natural": of["hm12"]["natural"].stop}},
        "uzawa_adds": {"least": min(added), "most": max(added)},
        "halving": {norm: max(price.halving for price in of[norm].values()) for norm in both},
    }


def newton_adds(crossed: xr.Dataset, H_over_h: float) -> float:
    """Operations of the active set's steps over the set-up's, on the finest mesh."""
    newton = crossed.sel(algorithm="newton", H_over_h=H_over_h).sel(stop=trade.SHOWN, method="nearest")
    at = newton.dropna("H").isel(H=-1)
    return float(at["operations"] / at["setup_operations"] - 1)


def plain(crossed: xr.Dataset, H_over_h: float) -> dict[str, Any]:
    """Uzawa's work over that of the cheapest algorithm, to the first and the last level shown."""
    first, last = (tables.at_level(crossed, H_over_h, stop)["work"] for stop in tables.LEVELS[::2])
    return {"first": first.sel(algorithm="uzawa").item(), "last": last.sel(algorithm="uzawa").item()}


def growth(crossed: xr.Dataset, coarsest: float) -> dict[str, Any]:
    """The exponents p of steps ~ H^-p, over H/h; by how many the steps of the active set grow at most."""
    ratios = [float(ratio) for ratio in crossed["H_over_h"].values if ratio <= LARGEST_RATIO]
    found: dict[str, Any] = {"largest_ratio": LARGEST_RATIO}
    for name in ("uzawa", "nesterov"):
        powers = [trade.growth(crossed, name, ratio, coarsest) for ratio in ratios]
        found[name] = {"least": min(powers), "most": max(powers)}
    return found | {"newton_more": int(crossed["steps"].sel(algorithm="newton").diff("H").max())}


def elimination(crossed: xr.Dataset, algebra: xr.Dataset, H_over_h: float) -> dict[str, Any]:
    """What the partial elimination saves in a step, what it costs, and when it has paid."""
    step, setup = algebra["step_operations"], algebra["setup_operations"].isel(H=-1)
    over_S, h = step / step.sel(algebra="S"), algebra["h"].sel(algebra="S")
    over_A = {
        name: float(
            trade.by_A_over_by_S(algebra, crossed, name, H_over_h).sel(stop=tables.LEVELS[0]).isel(H=-1)
        )
        for name in ("uzawa", "barzilai_borwein")
    }
    return over_A | {
        "coarse": {"h": float(h[0]), "A": float(over_S.sel(algebra="A")[0])},
        "fine": {"h": float(h[-1])} | {by: float(over_S.sel(algebra=by)[-1]) for by in ("A", "A_3")},
        "level": tables.LEVELS[0],
        "setup": float(setup.sel(algebra="S") / setup.sel(algebra="A")),
        "pays_after": math.ceil(trade.breaks_even(algebra)[-1]),
    }


def in_precision(precision: xr.Dataset) -> dict[str, Any]:
    """The lowest level that is reached on the finest mesh, in single precision and refined."""
    steps, per_step = precision["steps"].isel(H=-1), precision["step_operations"].isel(H=-1)
    adds = float(per_step.sel(precision="refined") / per_step.sel(precision="float64") - 1)
    lowest = steps["stop"].where(np.isfinite(steps)).min("stop")
    reached = {name: float(lowest.sel(precision=name)) for name in ("float32", "refined")}
    return {**reached, "refined_every": REFRESH, "refined_adds": adds}
