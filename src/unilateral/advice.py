"""What the study of cost lets recommend, for readers: tables and sentences whose numbers are the results'."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import xarray as xr

from unilateral import trade
from unilateral.documents import LINE, TITLES
from unilateral.rates import NORMS
from unilateral.variants import REFRESH

NAMES = {
    "uzawa": "Uzawa",
    "safe": "Uzawa, safe step",
    "optimal": "Uzawa, optimal step",
    "nesterov": "Nesterov",
    "barzilai_borwein": "Barzilai–Borwein",
    "newton": "active set (`newton`)",
}
COMPARED = ("newton", "barzilai_borwein", "nesterov", "uzawa")
LEVELS = (1e-1, 1e-3, 1e-6)
"""At which the algorithms are compared."""
LARGEST_RATIO = 4.0
"""Of H/h, up to which there are enough sizes for the growth of steps."""


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


def losses(cases: xr.Dataset) -> dict[str, dict[float, tuple[float, float]]]:
    """Per norm and H/h the least and the largest of `trade.losses` over the cases."""
    found = {}
    for norm in NORMS:
        of_cases = [trade.losses(cases.sel(case=name), norm) for name in cases["case"].values]
        ratios = sorted(set.intersection(*map(set, of_cases)))
        found[norm] = {r: (min(of[r] for of in of_cases), max(of[r] for of in of_cases)) for r in ratios}
    return found


def advice(crossed: xr.Dataset, cases: xr.Dataset, H_over_h: float, coarsest: float) -> str:
    """What to use: sentences, and a Markdown table of what to expect per norm, over all cases."""
    of, lost = prices(by_case(cases), H_over_h, coarsest), losses(cases)
    u, of_lambda = lost["h1"][H_over_h], lost["hm12"][H_over_h]
    lowest, name = min((price.stop, name) for name, price in of["hm12"].items())
    steps = [100 * (price.over_setup - 1) for price in of["h1"].values()]
    newton = (
        crossed.sel(algorithm="newton", H_over_h=H_over_h).sel(stop=trade.SHOWN, method="nearest").dropna("H")
    )
    active_set = 100 * float((newton["operations"] / newton["setup_operations"]).isel(H=-1) - 1)
    half = {norm: max(price.halving for price in by_name.values()) for norm, by_name in of.items()}
    text = (
        f"Take H = {H_over_h:g}h. At the same work the error of u is then at most {100 * (u[1] - 1):.0f} % "
        f"above that at the best H/h, in each of {len(cases['case'])} cases; that of λ is "
        f"{100 * (of_lambda[0] - 1):.0f} to {100 * (of_lambda[1] - 1):.0f} % above that at H/h = "
        f"{min(lost['hm12']):g}, which is outside the stability rule above. For u stop the iteration when "
        f"the guaranteed algebraic error is a tenth of ‖u−u_h‖₁. For λ stop when it is a tenth of ‖λ−λ_H‖ in "
        f"H^(−1/2), times β: for {name} that was {_stop(lowest)} of ‖u−u_h‖₁, a part that shrinks like "
        f"H^(1/2). For u most of the work is the set-up, whatever the algorithm: Uzawa's steps add "
        f"{min(steps):.0f} to {max(steps):.0f} %, those of the active set {active_set:.1g} % down to the "
        f"level {_stop(trade.SHOWN)}. Half the error costs about {half['h1']:.0f} times the work for u, "
        f"{half['hm12']:.0f} times for λ in H^(−1/2). `unilateral solve --accuracy` takes H = {H_over_h:g}h, "
        f"stops at a tenth of the error that is wanted, and uses Uzawa's algorithm; `--algorithm newton` "
        f"takes the active set."
    )
    h = next(iter(of["h1"].values())).h
    head = (
        f"| for the error of | stop at | relative error at h = {_size(h)} | operations | half of it costs |"
    )
    lines = [head, "|---" * 5 + "|"]
    for norm, by_name in of.items():
        found = list(by_name.values())
        cells = [TITLES[norm], _span([p.stop for p in found], _stop)]
        cells += [_span([p.error for p in found], _percent), _span([p.operations for p in found], _power)]
        cells += [_span([p.halving for p in found], _times)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([textwrap.fill(text, LINE), "", *lines])


def ratios(cases: xr.Dataset) -> str:
    """A Markdown table: per norm and H/h the error at the same work over that of the best H/h."""
    lost = losses(cases)
    of = list(lost["h1"])
    lines = [f"| H/h | {' | '.join(f'{ratio:g}' for ratio in of)} |", "|---" * (1 + len(of)) + "|"]
    for norm, found in lost.items():
        cells = [_span(list(found[ratio]), lambda x: f"{x:.2f}") for ratio in of]
        lines.append(f"| {TITLES[norm]} | {' | '.join(cells)} |")
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
            cells = [TITLES[norm], name, _stop(of.stop), _size(of.h), _percent(of.error)]
            cells += [_power(of.operations), f"{of.over_setup:.2f}", _times(of.halving)]
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def algorithms(crossed: xr.Dataset, H_over_h: float) -> str:
    """A Markdown table: on the finest mesh, steps to some levels, and the work over that of the cheapest."""
    at = crossed.sel(H_over_h=H_over_h).dropna("H", how="all", subset=["steps"]).isel(H=-1)
    heads = [f"{what} to {_stop(level)}" for level in LEVELS for what in ("steps", "work")]
    lines = [f"| algorithm | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
    for name in COMPARED:
        cells = []
        for level in LEVELS:
            here = at.sel(stop=level, method="nearest")
            work = here["operations"].sel(algorithm=name) / here["operations"].min("algorithm")
            cells += [_steps(here["steps"], name), f"{float(work):.2f}"]
        lines.append(f"| {NAMES[name]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def targets(crossed: xr.Dataset, wanted: Sequence[float]) -> str:
    """A Markdown table: per norm and relative error the cheapest run of Uzawa's that reaches it."""
    head = "| error of | at most | reached | H/h | h | stop at | operations |"
    lines = [head, "|---" * 7 + "|"]
    for norm in NORMS:
        for target in wanted:
            of = trade.cheapest(crossed, norm, target)
            if of:
                cells = [TITLES[norm], _percent(target), _percent(of["error"]), f"{of['H_over_h']:g}"]
                cells += [_size(of["h"]), _stop(of["stop"]), _power(of["operations"])]
                lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def growth(crossed: xr.Dataset, coarsest: float) -> str:
    """How steps grow."""
    text = (
        f"From H = {_size(coarsest)} on the steps to the level {_stop(trade.SHOWN)} grow like "
        f"{_exponents(crossed, 'uzawa', coarsest)} for Uzawa's algorithm, where theory has 1/H, and like "
        f"{_exponents(crossed, 'nesterov', coarsest)} for Nesterov's, where it has H^(−1/2); three or "
        f"four sizes do not confirm that exponent. The range is over H/h ≤ {LARGEST_RATIO:g}. The active set "
        f"takes about one step more when H is halved. Steps of Barzilai–Borwein's below {_stop(trade.SHOWN)} "
        f"depend on rounding; no more is said of them."
    )
    return textwrap.fill(text, LINE)


def elimination(crossed: xr.Dataset, algebra: xr.Dataset, H_over_h: float) -> str:
    """What the partial elimination saves in a step, what it costs, and when it has paid."""
    step = {name: algebra["step_operations"].sel(algebra=name).values for name in ("A", "A_3", "S")}
    share, of_A_3 = step["A"] / step["S"], step["A_3"][-1] / step["S"][-1]
    setup = algebra["setup_operations"].isel(H=-1)
    dearer = float(setup.sel(algebra="S") / setup.sel(algebra="A"))
    coarse, fine = (_size(h) for h in algebra["h"].sel(algebra="S").values[[0, -1]])
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
        f"To the level {_stop(LEVELS[0])} "
        f"Uzawa's algorithm by A would take {uzawa:.1f} times its operations by S; the method of "
        f"Barzilai and Borwein, of few steps, {other:.2f} times, without the guarantee."
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
        f"level {_stop(reached)}, and no lower one; with one product in double precision every {REFRESH} "
        f"steps, {100 * (refined - 1):.1g} % more operations a step, it reaches them all. Seconds and memory "
        f"of all runs, which depend on the machine, are in `results/cost/timings.nc`."
    )
    return textwrap.fill(text, LINE)


def _exponents(crossed: xr.Dataset, algorithm: str, coarsest: float) -> str:
    """The least and the largest over H/h."""
    of = [r for r in crossed["H_over_h"].values if r <= LARGEST_RATIO]
    powers = [trade.growth(crossed, algorithm, ratio, coarsest) for ratio in of]
    return _span([-power for power in powers], lambda p: f"H^({p:.1f})".replace("-", "−"))


def _span(values: Sequence[float], text: Callable[[float], str]) -> str:
    """The least and the largest as text, or the one text of both."""
    ends = dict.fromkeys(text(each) for each in (min(values), max(values)))
    return " to ".join(ends)


def _steps(finest: xr.DataArray, algorithm: str) -> str:
    """In two digits."""
    return f"{float(f'{float(finest.sel(algorithm=algorithm)):.2g}'):,.0f}".replace(",", " ")


def _stop(stop: float) -> str:
    return f"10^(−{-math.log10(stop):.0f})" if stop < 1 else "1"


def _size(h: float) -> str:
    return f"1/{1 / h:.0f}"


def _times(factor: float) -> str:
    return f"× {factor:.0f}"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %"


def _power(value: float) -> str:
    digits, exponent = f"{value:.1e}".split("e")
    return f"{digits}·10^{int(exponent)}"
