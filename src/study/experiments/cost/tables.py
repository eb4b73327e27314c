"""What the study of cost finds, as documents show it: prices, losses at the same work, steps, targets."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import pandas as pd
import xarray as xr

from study.experiments.cost import trade
from study.formats import TITLES, cells, shown, span
from study.tables import NORMS

NAMES = {
    "newton": "active set (`newton`)",
    "barzilai_borwein": "Barzilai–Borwein",
    "nesterov": "Nesterov",
    "uzawa": "Uzawa",
}
LEVELS = (1e-1, 1e-3, 1e-6)
"""The stopping levels at which the algorithms are compared."""
COUNTED = {"setup": "the set-up's", "uzawa": "all of Uzawa's"}
PRICE = {
    "stop at": ("stop", "10^"),
    "h": ("h", "1/n"),
    "relative error": ("error", ".2g%"),
    "operations": ("operations", "x10^"),
    "over set-up's": ("over_setup", ".2f"),
    "half of it costs": ("halving", "times"),
}
TARGET = {"reached": ("error", ".2g%"), "H/h": ("H_over_h", "g")} | {
    title: PRICE[title] for title in ("h", "stop at", "operations")
}
"""The columns by title: what of a run each shows, and in which format."""
Spans = dict[float, tuple[float, float]]


def by_case(cases: xr.Dataset) -> dict[str, xr.Dataset]:
    """The runs of each case, by its name."""
    return {str(name): cases.sel(case=name) for name in cases["case"].values}


def prices(
    runs: dict[str, xr.Dataset], H_over_h: float, coarsest: float
) -> dict[str, dict[str, trade.Price]]:
    """The prices by norm and name, at the largest level that is enough in that norm.

    `runs` are Uzawa's, over (H_over_h, H, stop).
    """
    by_norm: dict[str, dict[str, trade.Price]] = {norm: {} for norm in NORMS}
    for norm, (name, table) in itertools.product(NORMS, runs.items()):
        stop = trade.enough(table, norm, coarsest)
        by_norm[norm][name] = trade.price(table.sel(H_over_h=H_over_h), norm, stop, coarsest)
    return by_norm


def losses(cases: xr.Dataset, coarsest: float) -> dict[str, dict[str, Spans]]:
    """The least and the largest of `trade.losses` for each H/h, by norm and by the work that is counted.

    In "setup" the set-up alone is counted, and errors are those of the discrete solution; in "uzawa" it is
    all work of Uzawa's algorithm to the level that is enough for the case.
    """
    spans: dict[str, dict[str, Spans]] = {}
    for norm in NORMS:
        both: dict[str, list[dict[float, float]]] = {name: [] for name in COUNTED}
        for case in by_case(cases).values():
            error, work = trade.relative(case, norm), case["operations"]
            discrete = (error / trade.excess(case, norm)).isel(stop=-1)
            both["setup"].append(trade.losses(discrete, case["setup_operations"]))
            stop = trade.enough(case, norm, coarsest)
            both["uzawa"].append(trade.losses(error.sel(stop=stop), work.sel(stop=stop)))
        spans[norm] = {name: _spans(of_cases) for name, of_cases in both.items()}
    return spans


def _spans(of_cases: Sequence[dict[float, float]]) -> Spans:
    ratios_ = sorted(set.intersection(*map(set, of_cases)))
    return {
        ratio: (min(of[ratio] for of in of_cases), max(of[ratio] for of in of_cases)) for ratio in ratios_
    }


def best_ratio(spans: Spans) -> float:
    """The H/h whose largest loss is least."""
    return min(spans, key=lambda ratio: spans[ratio][1])


def ratios(cases: xr.Dataset, coarsest: float) -> pd.DataFrame:
    """Per norm and H/h the error at the same work over that of the best H/h."""
    lost = losses(cases, coarsest)
    of = sorted({ratio for by_work in lost.values() for spans in by_work.values() for ratio in spans})
    rows = [
        {"error of": TITLES[norm], "work": COUNTED[counted]}
        | {f"{ratio:g}": span(spans[ratio], ".2f") if ratio in spans else "" for ratio in of}
        for norm, by_work in lost.items()
        for counted, spans in by_work.items()
    ]
    return pd.DataFrame(rows)


def price_table(cases: xr.Dataset, scenes: xr.Dataset, H_over_h: float, coarsest: float) -> pd.DataFrame:
    """Per norm and case the level that is enough, what is reached there, and the price."""
    runs, base = {f"`{name}`": of for name, of in by_case(cases).items()}, cases["case"].values[0]
    for name in scenes["scene"].values[1:]:
        runs[f"`{base}`, {name}"] = scenes.sel(scene=name).expand_dims(H_over_h=[H_over_h])
    rows = [
        {"error of": TITLES[norm], "case": name} | cells(of._asdict(), PRICE)
        for norm, by_name in prices(runs, H_over_h, coarsest).items()
        for name, of in by_name.items()
    ]
    return pd.DataFrame(rows)


def expected(cases: xr.Dataset, H_over_h: float, coarsest: float) -> pd.DataFrame:
    """The least and the largest of `prices` over all cases, per norm."""
    rows = []
    for norm, by_name in prices(by_case(cases), H_over_h, coarsest).items():
        of = pd.DataFrame(by_name.values())
        titles = {"stop": "stop that was enough, of ‖u−u_h‖₁", "operations": "operations"}
        titles |= {
            "error": f"relative error at h = {shown(of['h'][0], '1/n')}",
            "halving": "half of it costs",
        }
        rows.append(
            {"for the error of": TITLES[norm]}
            | {titles[name]: span(of[name], spec) for name, spec in PRICE.values() if name in titles}
        )
    return pd.DataFrame(rows)


def at_level(crossed: xr.Dataset, H_over_h: float, stop: float) -> xr.Dataset:
    """The steps of each algorithm to a level on the finest mesh, and its work over that of the cheapest."""
    at = crossed.sel(H_over_h=H_over_h).dropna("H", how="all", subset=["steps"]).isel(H=-1)
    here = at[["steps", "operations"]].sel(stop=stop, method="nearest")
    return here.assign(work=here["operations"] / here["operations"].min("algorithm"))


def algorithms(crossed: xr.Dataset, H_over_h: float) -> pd.DataFrame:
    """The steps of each algorithm to some levels, and its work over that of the cheapest."""
    rows = [{"algorithm": title} for title in NAMES.values()]
    for stop in LEVELS:
        here, level = at_level(crossed, H_over_h, stop), shown(stop, "10^")
        for row, name in zip(rows, NAMES, strict=True):
            of = here.sel(algorithm=name)
            row[f"steps to {level}"] = shown(float(f"{of['steps'].item():.2g}"), "space")
            row[f"work to {level}"] = f"{of['work'].item():.2f}"
    return pd.DataFrame(rows)


def targets(crossed: xr.Dataset, wanted: Sequence[float]) -> pd.DataFrame:
    """Per norm and relative error the cheapest run of Uzawa's that reaches it.

    `wanted` falls; of several errors that one run reaches the least is shown.
    """
    rows = []
    for norm in NORMS:
        runs = [(target, trade.cheapest(crossed, norm, target)) for target in wanted]
        strictest = {run["operations"]: (target, run) for target, run in runs if run}
        rows += [
            {"error of": TITLES[norm], "at most": shown(target, ".2g%")} | cells(of, TARGET)
            for target, of in strictest.values()
        ]
    return pd.DataFrame(rows)
