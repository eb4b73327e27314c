"""What the study of cost recommends and what that is worth, as documents name it and show it in tables."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study.experiments.cost import trade
from study.experiments.cost.products import PRODUCTS_PER_REFRESH
from study.formats import ERROR_TITLES, format_row, format_span, format_value
from study.tables import ERROR_NORMS
from unilateral.formulas.formula import parse_real

MAX_GROWTH_RATIO = 4.0
"""The growth of steps is found for H/h up to this number, for which there are enough sizes."""
COMPARED_LEVELS = (1e-1, 1e-3, 1e-6)
"""The stopping levels at which the algorithms are compared."""
ALGORITHM_TITLES = {
    "newton": "active set (`newton`)",
    "barzilai_borwein": "Barzilai–Borwein",
    "nesterov": "Nesterov",
    "uzawa": "Uzawa",
}
WORK_TITLES = {"setup": "the set-up's", "uzawa": "all of Uzawa's"}
PRICE_COLUMNS = {
    "stop at": ("stop", "10^"),
    "h": ("h", "1/n"),
    "relative error": ("error", ".2g%"),
    "operations": ("operations", "x10^"),
    "over set-up's": ("over_setup", ".2f"),
    "half of it costs": ("halving", "times"),
}
TARGET_COLUMNS = {"reached": ("error", ".2g%"), "H/h": ("H_over_h", "g")} | {
    title: PRICE_COLUMNS[title] for title in ("h", "stop at", "operations")
}
"""The columns by title: what of a run each shows, and in which format."""
Spans = dict[float, tuple[float, float]]
"""The least and the largest of a number over all cases, by H/h."""


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """Recommendations of the study of cost and their worth, as documents name them."""
    H_over_h, coarsest = _recommended_sizes(study)
    crossed = results["cost/algorithm"]
    return {
        "cost": recommend(results["cost/case"], H_over_h, coarsest)
        | {
            "enough_times": trade.ENOUGH_FACTOR,
            "newton_adds": newton_share(crossed, H_over_h),
            "plain": {
                name: compare_algorithms(crossed, H_over_h, stop)["work"].sel(algorithm="uzawa").item()
                for name, stop in (("first", COMPARED_LEVELS[0]), ("last", COMPARED_LEVELS[-1]))
            },
            "growth": step_exponents(crossed, coarsest),
            "elimination": weigh_elimination(crossed, results["cost/algebra"], H_over_h),
            "precision": judge_precision(results["cost/precision"]),
        }
    }


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of the study of cost: ratios, prices, algorithms and targets."""
    H_over_h, coarsest = _recommended_sizes(study)
    return {
        "ratios": tabulate_ratios(results["cost/case"], coarsest),
        "prices": tabulate_prices(results["cost/case"], results["cost/scene"], H_over_h, coarsest),
        "expected": tabulate_price_spans(results["cost/case"], H_over_h, coarsest),
        "algorithms": tabulate_algorithms(results["cost/algorithm"], H_over_h),
        "targets": tabulate_targets(results["cost/algorithm"], study["cost"]["targets"]),
    }


def _recommended_sizes(study: Mapping[str, Any]) -> tuple[float, float]:
    """H/h of the runs that are recommended, and the largest H of fits."""
    cost = study["cost"]
    return parse_real(cost["base"]["H_over_h"], "cost.base.H_over_h"), parse_real(
        cost["fitted_from"], "cost.fitted_from"
    )


# The loss against the best H/h, the stop that is enough, and the price of an error.


def recommend(cases: xr.Dataset, H_over_h: float, coarsest: float) -> dict[str, Any]:
    """The recommended H/h and stop over all cases, and what they cost.

    That is the loss against the best H/h, that H/h, the stop that `natural` needs, the work that Uzawa adds
    to the set-up, and the factor of work for half the error.
    """
    losses = loss_spans(cases, coarsest)
    norms = ("h1", "hm12")
    by_norm = prices_by_norm(split_by_case(cases), H_over_h, coarsest)
    added = [price.over_setup - 1 for price in by_norm["h1"].values()]
    return {
        "cases": cases.sizes["case"],
        "compared_at": trade.COMPARED_LEVEL,
        "lowest": float(cases["stop"].min()),
        "loss": {
            norm: {work: spans[H_over_h][1] - 1 for work, spans in losses[norm].items()} for norm in norms
        },
        "best_ratio": {
            norm: {work: best_ratio(spans) for work, spans in losses[norm].items()} for norm in losses
        },
        "enough": {"hm12": {"natural": by_norm["hm12"]["natural"].stop}},
        "uzawa_adds": {"least": min(added), "most": max(added)},
        "halving": {norm: max(price.halving for price in by_norm[norm].values()) for norm in norms},
    }


def split_by_case(cases: xr.Dataset) -> dict[str, xr.Dataset]:
    """The runs of each case, by its name."""
    return {str(name): cases.sel(case=name) for name in cases["case"].values}


def prices_by_norm(
    runs: dict[str, xr.Dataset], H_over_h: float, coarsest: float
) -> dict[str, dict[str, trade.Price]]:
    """The prices by norm and name, at the largest level that is enough in that norm.

    `runs` are Uzawa's, over (H_over_h, H, stop).
    """
    by_norm: dict[str, dict[str, trade.Price]] = {norm: {} for norm in ERROR_NORMS}
    for norm, (name, table) in itertools.product(ERROR_NORMS, runs.items()):
        stop = trade.sufficient_stop(table, norm, coarsest)
        by_norm[norm][name] = trade.price_at_level(table.sel(H_over_h=H_over_h), norm, stop, coarsest)
    return by_norm


def loss_spans(cases: xr.Dataset, coarsest: float) -> dict[str, dict[str, Spans]]:
    """The least and the largest loss of all cases for each H/h, by norm and by the work that is counted.

    In "setup" the set-up alone is counted, and errors are those of the discrete solution; in "uzawa" it is
    all work of Uzawa's algorithm to the level that is enough for the case.
    """
    spans: dict[str, dict[str, Spans]] = {}
    for norm in ERROR_NORMS:
        setup_losses = []
        uzawa_losses = []
        for case in split_by_case(cases).values():
            error = trade.relative_errors(case, norm)
            work = case["operations"]
            discrete = trade.relative_errors(case, norm, quantity="discrete")
            setup_losses.append(trade.losses_by_ratio(discrete, case["setup_operations"]))
            stop = trade.sufficient_stop(case, norm, coarsest)
            uzawa_losses.append(trade.losses_by_ratio(error.sel(stop=stop), work.sel(stop=stop)))
        spans[norm] = {"setup": _common_spans(setup_losses), "uzawa": _common_spans(uzawa_losses)}
    return spans


def _common_spans(by_ratio: Sequence[dict[float, float]]) -> Spans:
    """The least and the largest loss of the H/h that all cases have."""
    common = sorted(set.intersection(*map(set, by_ratio)))
    return {
        ratio: (min(case[ratio] for case in by_ratio), max(case[ratio] for case in by_ratio))
        for ratio in common
    }


def best_ratio(spans: Spans) -> float:
    """The H/h whose largest loss is least."""
    return min(spans, key=lambda ratio: spans[ratio][1])


def tabulate_ratios(cases: xr.Dataset, coarsest: float) -> pd.DataFrame:
    """Per norm and H/h the error at the same work over that of the best H/h."""
    losses = loss_spans(cases, coarsest)
    ratios = sorted({ratio for by_work in losses.values() for spans in by_work.values() for ratio in spans})
    rows = [
        {"error of": ERROR_TITLES[norm], "work": WORK_TITLES[counted]}
        | {f"{ratio:g}": format_span(spans[ratio], ".2f") if ratio in spans else "" for ratio in ratios}
        for norm, by_work in losses.items()
        for counted, spans in by_work.items()
    ]
    return pd.DataFrame(rows)


def tabulate_prices(cases: xr.Dataset, scenes: xr.Dataset, H_over_h: float, coarsest: float) -> pd.DataFrame:
    """Per norm and case the level that is enough, what is reached there, and the price."""
    runs = {f"`{name}`": table for name, table in split_by_case(cases).items()}
    base = cases["case"].values[0]
    for name in scenes["scene"].values[1:]:
        runs[f"`{base}`, {name}"] = scenes.sel(scene=name).expand_dims(H_over_h=[H_over_h])
    rows = [
        {"error of": ERROR_TITLES[norm], "case": name} | format_row(price._asdict(), PRICE_COLUMNS)
        for norm, by_name in prices_by_norm(runs, H_over_h, coarsest).items()
        for name, price in by_name.items()
    ]
    return pd.DataFrame(rows)


def tabulate_price_spans(cases: xr.Dataset, H_over_h: float, coarsest: float) -> pd.DataFrame:
    """The least and the largest of `prices_by_norm` over all cases, per norm."""
    rows = []
    for norm, by_name in prices_by_norm(split_by_case(cases), H_over_h, coarsest).items():
        prices = pd.DataFrame(by_name.values())
        titles = {
            "stop": "stop that was enough, of ‖u−u_h‖₁",
            "operations": "operations",
            "error": f"relative error at h = {format_value(prices['h'][0], '1/n')}",
            "halving": "half of it costs",
        }
        rows.append(
            {"for the error of": ERROR_TITLES[norm]}
            | {
                titles[name]: format_span(prices[name], spec)
                for name, spec in PRICE_COLUMNS.values()
                if name in titles
            }
        )
    return pd.DataFrame(rows)


# Algorithms beside each other.


def compare_algorithms(crossed: xr.Dataset, H_over_h: float, stop: float) -> xr.Dataset:
    """The steps of each algorithm to a level on the finest mesh, and its work over that of the cheapest."""
    finest = crossed.sel(H_over_h=H_over_h).dropna("H", how="all", subset=["steps"]).isel(H=-1)
    compared = finest[["steps", "operations"]].sel(stop=stop, method="nearest")
    return compared.assign(work=compared["operations"] / compared["operations"].min("algorithm"))


def tabulate_algorithms(crossed: xr.Dataset, H_over_h: float) -> pd.DataFrame:
    """The steps of each algorithm to some levels, and its work over that of the cheapest."""
    rows = [{"algorithm": title} for title in ALGORITHM_TITLES.values()]
    for stop in COMPARED_LEVELS:
        compared = compare_algorithms(crossed, H_over_h, stop)
        level = format_value(stop, "10^")
        for row, name in zip(rows, ALGORITHM_TITLES, strict=True):
            run = compared.sel(algorithm=name)
            row[f"steps to {level}"] = format_value(float(f"{run['steps'].item():.2g}"), "space")
            row[f"work to {level}"] = f"{run['work'].item():.2f}"
    return pd.DataFrame(rows)


def tabulate_targets(crossed: xr.Dataset, targets: Sequence[float]) -> pd.DataFrame:
    """Per norm and relative error the cheapest run of Uzawa's that reaches it.

    `targets` falls; of several errors that one run reaches the least is shown.
    """
    rows = []
    for norm in ERROR_NORMS:
        runs = [(target, trade.cheapest_run(crossed, norm, target)) for target in targets]
        strictest = {run["operations"]: (target, run) for target, run in runs if run}
        rows += [
            {"error of": ERROR_TITLES[norm], "at most": format_value(target, ".2g%")}
            | format_row(run, TARGET_COLUMNS)
            for target, run in strictest.values()
        ]
    return pd.DataFrame(rows)


def newton_share(crossed: xr.Dataset, H_over_h: float) -> float:
    """Operations of the active set's steps over the set-up's, on the finest mesh."""
    newton = crossed.sel(algorithm="newton", H_over_h=H_over_h).sel(
        stop=trade.COMPARED_LEVEL, method="nearest"
    )
    finest = newton.dropna("H").isel(H=-1)
    return float(finest["operations"] / finest["setup_operations"] - 1)


def step_exponents(crossed: xr.Dataset, coarsest: float) -> dict[str, Any]:
    """The exponents p of steps ~ H^-p, over H/h; by how many the steps of the active set grow at most."""
    ratios = [float(ratio) for ratio in crossed["H_over_h"].values if ratio <= MAX_GROWTH_RATIO]
    exponents: dict[str, Any] = {"largest_ratio": MAX_GROWTH_RATIO}
    for name in ("uzawa", "nesterov"):
        powers = [trade.growth_exponent(crossed, name, ratio, coarsest) for ratio in ratios]
        exponents[name] = {"least": min(powers), "most": max(powers)}
    return exponents | {"newton_more": int(crossed["steps"].sel(algorithm="newton").diff("H").max())}


# Algebra and precision.


def weigh_elimination(crossed: xr.Dataset, algebra: xr.Dataset, H_over_h: float) -> dict[str, Any]:
    """Operations that the partial elimination saves in a step, its cost, and when it has paid."""
    step = algebra["step_operations"]
    setup = algebra["setup_operations"].isel(H=-1)
    over_S = step / step.sel(algebra="S")
    h = algebra["h"].sel(algebra="S")
    over_A = {
        name: float(
            trade.work_of_A_over_S(algebra, crossed, name, H_over_h).sel(stop=COMPARED_LEVELS[0]).isel(H=-1)
        )
        for name in ("uzawa", "barzilai_borwein")
    }
    return over_A | {
        "coarse": {"h": float(h[0]), "A": float(over_S.sel(algebra="A")[0])},
        "fine": {"h": float(h[-1])}
        | {matrix: float(over_S.sel(algebra=matrix)[-1]) for matrix in ("A", "A_3")},
        "level": COMPARED_LEVELS[0],
        "setup": float(setup.sel(algebra="S") / setup.sel(algebra="A")),
        "pays_after": math.ceil(trade.break_even_steps(algebra)[-1]),
    }


def judge_precision(precision: xr.Dataset) -> dict[str, Any]:
    """The lowest level that is reached on the finest mesh, in single precision and refined.

    The lowest level of all is left out: rounding decides whether double precision reaches it.
    """
    steps = precision["steps"].isel(H=-1, stop=slice(None, -1))
    per_step = precision["step_operations"].isel(H=-1)
    adds = float(per_step.sel(precision="refined") / per_step.sel(precision="float64") - 1)
    lowest = steps["stop"].where(np.isfinite(steps)).min("stop")
    reached = {name: float(lowest.sel(precision=name)) for name in ("float32", "refined")}
    return {**reached, "refined_every": PRODUCTS_PER_REFRESH, "refined_adds": adds}
