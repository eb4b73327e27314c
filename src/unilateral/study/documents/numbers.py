"""The named numbers of the documents, raw: the study's parameters, its claims, and what its tables say."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.formulas.formula import real
from unilateral.norms.resolution import RULE
from unilateral.study.documents.sources import Sources
from unilateral.study.experiments.adaptive import numbers as adaptive
from unilateral.study.experiments.benchmarks import commands
from unilateral.study.experiments.benchmarks import numbers as benchmarks
from unilateral.study.experiments.cost import numbers as cost
from unilateral.study.experiments.cost import trade
from unilateral.study.experiments.cost.variants import REFRESH
from unilateral.study.experiments.extremes import numbers as extremes
from unilateral.study.experiments.extremes.kinds import RESCUED, kinds
from unilateral.study.experiments.stability.numbers import ROUNDED
from unilateral.study.formats import Value
from unilateral.study.ledger.records import ORIGINS, origin

LARGEST_RATIO = 4.0
"""Of H/h, up to which there are enough sizes for the growth of steps."""
SPARE = 3
"""A factor: digits of what is rounding are not reproducible."""
LAWS = ("odd", "shift", "short", "short_loaded", "scale_down", "scale_up", "angle", "slit", "side", "aspect")
"""The axes whose numbers are cond(S)."""
Group = dict[str, Any]


def collect(told: Sources) -> dict[str, Value]:
    """All numbers by name."""
    of, H_over_h, coarsest = told.tables, told.H_over_h, told.coarsest
    return flat(
        {
            "study": {**told.study, "infsup": {"rule": RULE._asdict()}},
            "claims": {each["id"]: {"observed": each["observed"]} for each in told.claims}
            | ledger(told.claims),
            "beta": beta(told.pairs, *RULE) | uniform_beta(told.pairs) | inner_nodes(told.pairs),
            "theorems": theorems({each["id"]: each["observed"] for each in told.claims}),
            "cost": recommended(of["case"], H_over_h, coarsest)
            | {
                "enough_times": trade.ENOUGH,
                "newton_adds": newton_adds(of["algorithm"], H_over_h),
                "plain": plain(of["algorithm"], H_over_h),
                "growth": growth(of["algorithm"], coarsest),
                "elimination": elimination(of["algorithm"], of["algebra"], H_over_h),
                "precision": in_precision(of["precision"]),
            },
            "totals": totals(told.totals["corners"]),
            "adapted": adaptive.beta(of["adapted_beta"], RULE.smallest_angle),
            "extremes": outcomes(of["extremes"]),
            "benchmarks": benchmarks.numbers(of["benchmarks"]),
            "commands": commands.numbers(told.commands),
            "scores": {name: real(told.scores[name].iloc[0], name) for name in ("h", "H")},
            "whole": {"cores": told.whole["cores"]}
            | {name: taken(told.whole[name]) for name in ("solver", "study", "tests")},
        }
    )


def ledger(claims: Sequence[Mapping[str, Any]]) -> Group:
    """How many claims have a check and how many have none, and where the required numbers come from."""
    origins = Counter(origin(each["source"]) for each in claims if each["source"] is not None)
    known = {"all": origins.total(), "unmeasured": len(claims) - origins.total()}
    return known | {"thresholds": {name: origins[name] for name in ORIGINS}}


def taken(measured: Mapping[str, float]) -> Group:
    """Minutes, and GB of memory and of the disk, from seconds and MB."""
    sizes = {name: measured[name] / 1024 for name in ("memory", "disk") if name in measured}
    return {"minutes": measured["seconds"] / 60, **sizes}


def flat(groups: Mapping[str, Any], above: str = "") -> dict[str, Value]:
    """{"a": {"b": 1, "c": [2]}} as {"a.b": 1}: a name leads through the groups, and lists have none."""
    found: dict[str, Value] = {}
    for name, of in groups.items():
        if isinstance(of, Mapping):
            found |= flat(of, f"{above}{name}.")
        elif isinstance(of, Value):
            found[f"{above}{name}"] = of
    return found


def beta(pairs: pd.DataFrame, cell_over_edge: float, smallest_angle: float) -> Group:
    """How many pairs keep the rule; the worst with flat triangles, and, of a search, by edges alone."""
    few = cell_over_edge * (1 - ROUNDED)
    flat_ones, fine = pairs["smallest_angle"] < smallest_angle, pairs["cell_over_edge"] >= few
    searched = pairs[(pairs["kind"] == "worst") & (pairs["edges_per_cell"] >= few)]
    worst = {
        name: of.nsmallest(1, "beta_upper").iloc[0]
        for name, of in (("flat", pairs[fine & flat_ones]), ("edges", searched))
    }
    return {"kept": len(pairs[fine & ~flat_ones])} | {
        name: {"beta": float(of["beta_upper"]), "mesh": of["label"], "angle": float(of["smallest_angle"])}
        for name, of in worst.items()
    }


def uniform_beta(pairs: pd.DataFrame) -> Group:
    """The least beta on uniform meshes with h < H; and that of an odd number of edges at H = h."""
    ratio, equal = pairs["h_over_H"], np.isclose(pairs["h_over_H"], 1, rtol=ROUNDED)
    below = (pairs["kind"] == "uniform") & (ratio < 1) & ~equal
    odd = pairs.loc[(pairs["scene"] == "betaodd") & equal, "beta_lower"]
    return {"uniform": float(pairs.loc[below, "beta_lower"].min()), "odd": odd.item()}


def inner_nodes(pairs: pd.DataFrame) -> Group:
    """How many pairs there are; the least beta at h = H with nodes in the middle of the cells."""
    equal = np.isclose(pairs["h_over_H"], 1, rtol=ROUNDED) & np.isclose(pairs["delta"], 0.5, rtol=ROUNDED)
    return {
        "pairs": len(pairs),
        "middle": float(pairs.loc[equal & (pairs["alpha_1"] == 1), "beta_lower"].min()),
    }


def theorems(observed: Mapping[str, float]) -> Group:
    """By how much an exponent of Theorem 2 is missed at most, and how near Lemma 1 comes to its bound."""
    return {"deficit": max(0.0, -observed["T.H"]), "slack": 1 - observed["T.D"]}


def recommended(cases: xr.Dataset, H_over_h: float, coarsest: float) -> Group:
    """Over all cases: the loss against the best H/h, that H/h, the stops, Uzawa's share, half the error."""
    lost = cost.losses(cases, coarsest)
    of = cost.prices(cost.by_case(cases), H_over_h, coarsest)
    added = [price.over_setup - 1 for price in of["h1"].values()]
    return {
        "cases": cases.sizes["case"],
        "compared_at": trade.SHOWN,
        "lowest": float(cases["stop"].min()),
        "loss": {n: {work: by[H_over_h][1] - 1 for work, by in lost[n].items()} for n in lost},
        "best_ratio": {n: {work: cost.best_ratio(by) for work, by in lost[n].items()} for n in lost},
        "enough": {norm: {name: price.stop for name, price in of[norm].items()} for norm in of},
        "uzawa_adds": {"least": min(added), "most": max(added)},
        "halving": {norm: max(price.halving for price in of[norm].values()) for norm in of},
    }


def newton_adds(crossed: xr.Dataset, H_over_h: float) -> float:
    """Operations of the active set's steps over the set-up's, on the finest mesh."""
    newton = crossed.sel(algorithm="newton", H_over_h=H_over_h).sel(stop=trade.SHOWN, method="nearest")
    at = newton.dropna("H").isel(H=-1)
    return float(at["operations"] / at["setup_operations"] - 1)


def plain(crossed: xr.Dataset, H_over_h: float) -> Group:
    """Uzawa's work over that of the cheapest algorithm, to the first and the last level shown."""
    first, last = (cost.at_level(crossed, H_over_h, stop)["work"] for stop in cost.LEVELS[::2])
    return {"first": first.sel(algorithm="uzawa").item(), "last": last.sel(algorithm="uzawa").item()}


def totals(corners: xr.Dataset) -> Group:
    """On how many meshes totals are bounded; at the re-entrant vertex lambda's bound over its error."""
    index = corners["total_index_lambda"].sel(case="reentrant").values
    return {"meshes": len(index), "reentrant": {"coarsest": float(index[0]), "finest": float(index[-1])}}


def growth(crossed: xr.Dataset, coarsest: float) -> Group:
    """The exponents p of steps ~ H^-p, over H/h; by how many the steps of the active set grow at most."""
    ratios = [float(ratio) for ratio in crossed["H_over_h"].values if ratio <= LARGEST_RATIO]
    found: Group = {"largest_ratio": LARGEST_RATIO}
    for name in ("uzawa", "nesterov"):
        powers = [trade.growth(crossed, name, ratio, coarsest) for ratio in ratios]
        found[name] = {"least": min(powers), "most": max(powers)}
    return found | {"newton_more": int(crossed["steps"].sel(algorithm="newton").diff("H").max())}


def elimination(crossed: xr.Dataset, algebra: xr.Dataset, H_over_h: float) -> Group:
    """What the partial elimination saves in a step, what it costs, and when it has paid."""
    step, setup = algebra["step_operations"], algebra["setup_operations"].isel(H=-1)
    over_S, h = step / step.sel(algebra="S"), algebra["h"].sel(algebra="S")
    found: Group = {
        name: {"h": float(h[k])} | {by: float(over_S.sel(algebra=by)[k]) for by in ("A", "A_3")}
        for name, k in (("coarse", 0), ("fine", -1))
    }
    for name in ("uzawa", "barzilai_borwein"):
        by_A = trade.by_A_over_by_S(algebra, crossed, name, H_over_h)
        found[name] = float(by_A.sel(stop=cost.LEVELS[0]).isel(H=-1))
    return found | {
        "level": cost.LEVELS[0],
        "setup": float(setup.sel(algebra="S") / setup.sel(algebra="A")),
        "pays_after": math.ceil(trade.breaks_even(algebra)[-1]),
    }


def in_precision(precision: xr.Dataset) -> Group:
    """The lowest level that is reached on the finest mesh, in single precision and refined."""
    steps, per_step = precision["steps"].isel(H=-1), precision["step_operations"].isel(H=-1)
    adds = float(per_step.sel(precision="refined") / per_step.sel(precision="float64") - 1)
    lowest = steps["stop"].where(np.isfinite(steps)).min("stop")
    reached = {name: float(lowest.sel(precision=name)) for name in ("float32", "refined")}
    return {**reached, "refined_every": REFRESH, "refined_adds": adds}


def outcomes(table: xr.Dataset) -> Group:
    """How many points there are, what became of them, what rounding explains, how far rho may go."""
    count, solved = Counter(kinds(table).tolist()), table["u_norm"].values > 0
    share = (table["allowance"] / table["u_norm"]).values[solved]
    over_law = (table["measured"] / table["predicted"]).values[np.isin(table["axis_of"].values, LAWS)]
    return {
        "points": table.sizes["point"],
        "axes": {"all": table.sizes["axis"], "unlimited": len(extremes.dull(table))},
        **{name: count[name.replace("_", " ")] for name in ("right", "not_converged", "refused", "wrong")},
        "by_tool": count[RESCUED],
        "allowed": 10.0 ** math.ceil(math.log10(SPARE * np.max(share))),
        "cond_over_law": float(np.max(over_law[np.isfinite(over_law)])),
        "partial": {axis: _last_and_first(table, f"{axis}_partial") for axis in ("step", "printed")},
    }


def _last_and_first(table: xr.Dataset, axis: str) -> Group:
    """The last value before the first that is not right, that one, and the local limit."""
    of, values = table.sel(axis=axis), table["value"].values[table["axis_of"].values == axis]
    first = float(of["measured_limit"])
    return {"right": float(values[values < first].max()), "fails": first, "local": float(of["local_limit"])}
