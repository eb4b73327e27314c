"""What the study of cost lets recommend, for readers: tables and sentences whose numbers are the results'."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping, Sequence

import xarray as xr

from unilateral.study.judge import cost as trade
from unilateral.study.judge.rates import NORMS
from unilateral.study.text.documents import LINE, TITLES
from unilateral.study.text.wording import level, percent, power, size, span, times

Spans = dict[float, tuple[float, float]]


def prices(
    runs: Mapping[str, xr.Dataset], H_over_h: float, coarsest: float
) -> dict[str, dict[str, trade.Price]]:
    """Per norm, of runs of Uzawa's over (H_over_h, H, stop), at the largest level that is enough for it."""
    found: dict[str, dict[str, trade.Price]] = {norm: {} for norm in NORMS}
    for norm, (name, table) in itertools.product(NORMS, runs.items()):
        stop = trade.enough(table, norm, coarsest)
        found[norm][name] = trade.price(table.sel(H_over_h=H_over_h), norm, stop, coarsest)
    return found


def by_case(cases: xr.Dataset) -> dict[str, xr.Dataset]:
    """The runs of each."""
    return {f"`{name}`": cases.sel(case=name) for name in cases["case"].values}


def losses(cases: xr.Dataset, coarsest: float) -> dict[str, dict[str, Spans]]:
    """By `trade.losses`, per norm and by the work that is counted, of each H/h the least and the largest.

    In "set-up" the set-up alone is counted, and errors are those of the discrete solution; in "uzawa" all
    work of Uzawa's algorithm to the level that is enough for the case.
    """
    found: dict[str, dict[str, Spans]] = {}
    for norm in NORMS:
        both: dict[str, list[dict[float, float]]] = {"set-up": [], "uzawa": []}
        for case in by_case(cases).values():
            error, work = trade.relative(case, norm), case["operations"]
            discrete = (error / trade.excess(case, norm)).isel(stop=-1)
            both["set-up"].append(trade.losses(discrete, case["setup_operations"]))
            stop = trade.enough(case, norm, coarsest)
            both["uzawa"].append(trade.losses(error.sel(stop=stop), work.sel(stop=stop)))
        found[norm] = {name: _spans(of_cases) for name, of_cases in both.items()}
    return found


def _spans(of_cases: Sequence[dict[float, float]]) -> Spans:
    ratios_ = sorted(set.intersection(*map(set, of_cases)))
    return {
        ratio: (min(of[ratio] for of in of_cases), max(of[ratio] for of in of_cases)) for ratio in ratios_
    }


def advice(crossed: xr.Dataset, cases: xr.Dataset, H_over_h: float, coarsest: float) -> str:
    """What to use: sentences, and a Markdown table of what to expect per norm, over all cases."""
    of, lost = prices(by_case(cases), H_over_h, coarsest), losses(cases, coarsest)
    few, many = (
        {norm: [100 * (end - 1) for end in lost[norm][counted][H_over_h]] for norm in ("h1", "hm12")}
        for counted in ("set-up", "uzawa")
    )
    lowest, name = min((price.stop, name) for name, price in of["hm12"].items())
    of_lambda = of["hm12"].values()
    steps = [100 * (price.over_setup - 1) for price in of["h1"].values()]
    newton = (
        crossed.sel(algorithm="newton", H_over_h=H_over_h).sel(stop=trade.SHOWN, method="nearest").dropna("H")
    )
    active_set = 100 * float((newton["operations"] / newton["setup_operations"]).isel(H=-1) - 1)
    half = {norm: max(price.halving for price in by_name.values()) for norm, by_name in of.items()}
    worth = [
        f"H/h: take H = {H_over_h:g}h. In each of {len(cases['case'])} cases the error of u is then at most "
        f"{few['h1'][1]:.0f} % above that at the best H/h and the same work if steps cost next to nothing, "
        f"as with the active set, and {many['h1'][1]:.0f} % with Uzawa's algorithm; that of λ in H^(−1/2) is "
        f"at most {few['hm12'][1]:.0f} and {many['hm12'][1]:.0f} %, the better ratio then being "
        f"{min(lost['hm12']['set-up']):g}, which is outside the stability rule above.",
        "Stop: for u when the guaranteed algebraic error is a tenth of ‖u−u_h‖₁; for λ when, over β, it is a "
        f"tenth of the error of λ that is wanted. In hindsight {level(max(p.stop for p in of_lambda))} of "
        f"‖u−u_h‖₁ was enough for λ, too, but for {name}, which needed {level(lowest)}.",
        "Algorithm: for u most of the work is the set-up. To that stop Uzawa's steps add "
        f"{min(steps):.0f} to {max(steps):.0f} %; those of the active set add {active_set:.1g} %, even down "
        f"to the level {level(trade.SHOWN)}.",
        f"Cost: half the error takes about {half['h1']:.0f} times the work for u, {half['hm12']:.0f} times "
        "for λ in H^(−1/2).",
        f"`unilateral solve --accuracy` takes H = {H_over_h:g}h and these stops, and Uzawa's algorithm; "
        "`--algorithm newton` takes the active set.",
    ]
    h = next(iter(of["h1"].values())).h
    head = (
        f"| for the error of | stop that was enough, of ‖u−u_h‖₁ | relative error at h = {size(h)} "
        "| operations | half of it costs |"
    )
    lines = [head, "|---" * 5 + "|"]
    for norm, by_name in of.items():
        found = list(by_name.values())
        cells = [TITLES[norm], span([p.stop for p in found], level)]
        cells += [
            span([p.error for p in found], percent),
            span([p.operations for p in found], power),
        ]
        cells += [span([p.halving for p in found], times)]
        lines.append(f"| {' | '.join(cells)} |")
    listed = [textwrap.fill(each, LINE, initial_indent="- ", subsequent_indent="  ") for each in worth]
    return "\n".join([*listed, "", *lines])
