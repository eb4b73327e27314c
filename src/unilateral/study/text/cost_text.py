"""What the study of cost says, for the paper: tables and sentences whose numbers are the results'."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import numpy as np
import xarray as xr

from unilateral.study.judge import cost as trade
from unilateral.study.judge.rates import NORMS
from unilateral.study.runs.cost.variants import REFRESH
from unilateral.study.text.advice import by_case, losses, prices
from unilateral.study.text.documents import LINE, TITLES
from unilateral.study.text.wording import level, percent, power, size, span, times

NAMES = {
    "uzawa": "Uzawa",
    "nesterov": "Nesterov",
    "barzilai_borwein": "Barzilai–Borwein",
    "newton": "active set (`newton`)",
}
COMPARED = ("newton", "barzilai_borwein", "nesterov", "uzawa")
LEVELS = (1e-1, 1e-3, 1e-6)
"""At which the algorithms are compared."""
COUNTED = {"set-up": "the set-up's", "uzawa": "all of Uzawa's"}
LARGEST_RATIO = 4.0
"""Of H/h, up to which there are enough sizes for the growth of steps."""


def ratios(cases: xr.Dataset, coarsest: float) -> str:
    """A Markdown table: per norm and H/h the error at the same work over that of the best H/h."""
    lost = losses(cases, coarsest)
    of = sorted({ratio for by_work in lost.values() for spans in by_work.values() for ratio in spans})
    lines = [
        f"| error of | work | {' | '.join(f'{ratio:g}' for ratio in of)} |",
        "|---" * (2 + len(of)) + "|",
    ]
    for norm, by_work in lost.items():
        for counted, spans in by_work.items():
            cells = [span(spans[ratio], lambda x: f"{x:.2f}") if ratio in spans else "" for ratio in of]
            lines.append(f"| {TITLES[norm]} | {COUNTED[counted]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def price_table(cases: xr.Dataset, scenes: xr.Dataset, H_over_h: float, coarsest: float) -> str:
    """A Markdown table: per norm and case the level that is enough, what is reached there, and the price."""
    runs, base = by_case(cases), cases["case"].values[0]
    for name in scenes["scene"].values[1:]:
        runs[f"`{base}`, {name}"] = scenes.sel(scene=name).expand_dims(H_over_h=[H_over_h])
    head = (
        "| error of | case | stop at | h | relative error | operations | over set-up's | half of it costs |"
    )
    lines = [head, "|---" * 8 + "|"]
    for norm, by_name in prices(runs, H_over_h, coarsest).items():
        for name, of in by_name.items():
            cells = [
                TITLES[norm],
                name,
                level(of.stop),
                size(of.h),
                percent(of.error),
            ]
            cells += [power(of.operations), f"{of.over_setup:.2f}", times(of.halving)]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def algorithms(crossed: xr.Dataset, H_over_h: float) -> str:
    """A Markdown table: on the finest mesh, steps to some levels, and the work over that of the cheapest."""
    at = crossed.sel(H_over_h=H_over_h).dropna("H", how="all", subset=["steps"]).isel(H=-1)
    heads = [f"{what} to {level(stop)}" for stop in LEVELS for what in ("steps", "work")]
    lines = [f"| algorithm | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
    for name in COMPARED:
        cells = []
        for stop in LEVELS:
            here = at.sel(stop=stop, method="nearest")
            work = here["operations"].sel(algorithm=name) / here["operations"].min("algorithm")
            cells += [_steps(here["steps"], name), f"{float(work):.2f}"]
        lines.append(f"| {NAMES[name]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def targets(crossed: xr.Dataset, wanted: Sequence[float]) -> str:
    """A Markdown table: per norm and relative error the cheapest run of Uzawa's that reaches it.

    `wanted` falls; of several errors that one run reaches the least is shown.
    """
    head = "| error of | at most | reached | H/h | h | stop at | operations |"
    lines = [head, "|---" * 7 + "|"]
    for norm in NORMS:
        runs = [(target, trade.cheapest(crossed, norm, target)) for target in wanted]
        strictest = {run["operations"]: (target, run) for target, run in runs if run}
        for target, of in strictest.values():
            cells = [TITLES[norm], percent(target), percent(of["error"]), f"{of['H_over_h']:g}"]
            cells += [size(of["h"]), level(of["stop"]), power(of["operations"])]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def growth(crossed: xr.Dataset, coarsest: float) -> str:
    """How steps grow."""
    newton = crossed["steps"].sel(algorithm="newton").diff("H")
    more = float(newton.max())
    text = (
        f"From H = {size(coarsest)} on the steps to the level {level(trade.SHOWN)} grow like "
        f"{_exponents(crossed, 'uzawa', coarsest)} for Uzawa's algorithm, where theory has 1/H, and like "
        f"{_exponents(crossed, 'nesterov', coarsest)} for Nesterov's, where it has H^(−1/2). The "
        f"range is over H/h ≤ {LARGEST_RATIO:g}, each with three or four H. The active set takes at most "
        f"{more:.0f} steps more when H is halved. Steps of Barzilai–Borwein's below {level(trade.SHOWN)} "
        f"depend on rounding; no more is said of them."
    )
    return textwrap.fill(text, LINE)


def elimination(crossed: xr.Dataset, algebra: xr.Dataset, H_over_h: float) -> str:
    """What the partial elimination saves in a step, what it costs, and when it has paid."""
    step = {name: algebra["step_operations"].sel(algebra=name).values for name in ("A", "A_3", "S")}
    share, of_A_3 = step["A"] / step["S"], step["A_3"][-1] / step["S"][-1]
    setup = algebra["setup_operations"].isel(H=-1)
    dearer = float(setup.sel(algebra="S") / setup.sel(algebra="A"))
    coarse, fine = (size(h) for h in algebra["h"].sel(algebra="S").values[[0, -1]])
    uzawa, other = (
        float(trade.by_A_over_by_S(algebra, crossed, name, H_over_h).sel(stop=LEVELS[0]).isel(H=-1))
        for name in ("uzawa", "barzilai_borwein")
    )
    text = (
        f"At H = {H_over_h:g}h a step with A factorised, by nested dissection of all nodes, takes "
        f"{share[0]:.0f} times the operations of one with S at h = {coarse} and {share[-1]:.0f} times at h = "
        f"{fine}, one with A₃ {of_A_3:.0f} times. But the elimination puts the boundary last, which fills "
        f"the factors, and S has to be formed: the set-up takes {dearer:.0f} times that with A alone, and "
        f"has paid after {math.ceil(trade.breaks_even(algebra)[-1])} steps at h = {fine} "
        f"(without the spectrum, of which the guaranteed stop needs λ_min whatever the matrix). "
        f"To the level {level(LEVELS[0])}, and without the guarantee in both, Uzawa's algorithm by A takes "
        f"{uzawa:.1f} times its operations by S; the method of Barzilai and Borwein, of few steps, "
        f"{other:.2f} times."
    )
    return textwrap.fill(text, LINE)


def in_precision(precision: xr.Dataset) -> str:
    """What single precision reaches."""
    single = precision["steps"].sel(precision="float32").isel(H=-1)
    reached = float(single["stop"][int(np.flatnonzero(np.isfinite(single.values))[-1])])
    per_step = precision["step_operations"].isel(H=-1)
    refined = float(per_step.sel(precision="refined") / per_step.sel(precision="float64"))
    text = (
        f"With S and the product Sμ in single precision, and the rest in double, the finest mesh reaches the "
        f"level {level(reached)}, and no lower one; with one product in double precision every {REFRESH} "
        f"steps, {100 * (refined - 1):.1g} % more operations a step (one in single counted like "
        f"one in double), it reaches them all. Seconds and memory "
        f"of all runs, which depend on the machine, are in `results/cost/timings.nc`."
    )
    return textwrap.fill(text, LINE)


def _exponents(crossed: xr.Dataset, algorithm: str, coarsest: float) -> str:
    """The least and the largest over H/h."""
    of = [r for r in crossed["H_over_h"].values if r <= LARGEST_RATIO]
    powers = [trade.growth(crossed, algorithm, ratio, coarsest) for ratio in of]
    return span([-power for power in powers], lambda p: f"H^({p:.1f})".replace("-", "−"))


def _steps(finest: xr.DataArray, algorithm: str) -> str:
    """In two digits."""
    return f"{float(f'{float(finest.sel(algorithm=algorithm)):.2g}'):,.0f}".replace(",", " ")
