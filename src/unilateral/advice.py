"""What the study of cost lets recommend, for readers: tables and sentences whose numbers are the results'."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

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
    "newton": "active set",
}
COMPARED = ("newton", "barzilai_borwein", "nesterov", "uzawa")


def advice(crossed: xr.Dataset, cases: xr.Dataset, coarsest: float) -> str:
    """A Markdown table: per norm what to use, what it reaches and costs; and when that stop is not enough."""
    chosen = {norm: trade.choice(crossed, cases, norm, coarsest) for norm in NORMS}
    lines = [
        "| for the error of | H/h | stop at | relative error | at h | operations | half of it costs |"
        f" {' | '.join(NAMES[name] for name in COMPARED)} |",
        "|---" * (7 + len(COMPARED)) + "|",
    ]
    for norm, of in chosen.items():
        cells = [TITLES[norm], f"{of.H_over_h:g}", _stop(of.stop), _percent(of.error), f"1/{1 / of.h:.0f}"]
        cells += [_power(of.operations), f"× {of.halving:.1f}"]
        cells += [f"{of.of_algorithms[name]:.2f}" for name in COMPARED]
        lines.append(f"| {' | '.join(cells)} |")
    cheapest = [NAMES[min(of.of_algorithms, key=of.of_algorithms.__getitem__)] for of in chosen.values()]
    worst = float(trade.excess(cases.sel(H=cases["H"] <= coarsest), "hm12").sel(stop=chosen["h1"].stop).max())
    text = (
        f"The stop is a guaranteed algebraic error, as a part of ‖u−u_h‖₁; it leaves no error of any case "
        f"above {trade.ENOUGH:g} times that of the discrete solution. What is enough for u is not for λ: "
        f"at {_stop(chosen['h1'].stop)} the error of λ in H^(−1/2) is up to {worst:.1f} times as large as it "
        f"could be. The last columns compare the algorithms: all operations, set-up too, over the least. "
        f"Cheapest: {', '.join(dict.fromkeys(cheapest))}."
    )
    return "\n".join([*lines, "", textwrap.fill(text, LINE)])


def targets(crossed: xr.Dataset, wanted: Sequence[float]) -> str:
    """A Markdown table: per norm and relative error the cheapest run that reaches it."""
    head = "| error of | at most | reached | H/h | h | stop at | algorithm | operations |"
    lines = [head, "|---" * 8 + "|"]
    for norm in NORMS:
        for target in wanted:
            of = trade.cheapest(crossed, norm, target)
            if of:
                cells = [TITLES[norm], _percent(target), _percent(of["error"]), f"{of['H_over_h']:g}"]
                cells += [f"1/{1 / of['h']:.0f}", _stop(of["stop"]), NAMES[of["algorithm"]]]
                lines.append(f"| {' | '.join([*cells, _power(of['operations'])])} |")
    return "\n".join(lines)


def halving(cases: xr.Dataset, scenes: xr.Dataset, crossed: xr.Dataset, coarsest: float) -> str:
    """A Markdown table: the factor of work for half of the error; plain Uzawa, H = 2h, each enough stop."""
    chosen = {norm: trade.choice(crossed, cases, norm, coarsest) for norm in NORMS}
    rows = {f"`{name}`": cases.sel(case=name) for name in cases["case"].values}
    other = [name for name in scenes["scene"].values if name != scenes["scene"].values[0]]
    base = cases["case"].values[0]
    rows |= {f"`{base}`, {name}": scenes.sel(scene=name) for name in other}
    lines = ["| case | " + " | ".join(TITLES[norm] for norm in NORMS) + " |", "|---" * 4 + "|"]
    for name, table in rows.items():
        fine = table.sel(H=table["H"] <= coarsest)
        factors = []
        for norm in NORMS:
            at = fine.sel(stop=chosen[norm].stop)
            factors.append(trade.halving(at["operations"].values, trade.relative(at, norm).values))
        lines.append(f"| {name} | " + " | ".join(f"{factor:.1f}" for factor in factors) + " |")
    lines.append("| work like $h^{-3}$ | " + " | ".join(f"{of.theory:.0f}" for of in chosen.values()) + " |")
    return "\n".join(lines)


def sentences(
    crossed: xr.Dataset, algebra: xr.Dataset, precision: xr.Dataset, H_over_h: float, coarsest: float
) -> str:
    """How steps grow, what the partial elimination saves, and what single precision reaches."""
    power = {name: trade.growth(crossed, name, H_over_h, coarsest) for name in COMPARED}
    last = crossed["steps"].sel(H_over_h=H_over_h).isel(stop=-1)
    finest = last.dropna("H").isel(H=-1)
    step = {name: algebra["step_operations"].sel(algebra=name).values for name in ("A", "A_3", "S")}
    share, of_A_3 = step["A"] / step["S"], step["A_3"][-1] / step["S"][-1]
    coarse, fine = (f"1/{1 / h:.0f}" for h in algebra["h"].sel(algebra="S").values[[0, -1]])
    single = precision["steps"].sel(precision="float32").isel(H=-1)
    reached = float(single["stop"][int(np.flatnonzero(np.isfinite(single.values))[-1])])
    text = (
        f"At H = {H_over_h:g}h the steps for the last five digits grow like "
        f"H^(−{power['uzawa']:.2f}) for Uzawa's algorithm, H^(−{power['nesterov']:.2f}) for Nesterov's and "
        f"H^(−{power['barzilai_borwein']:.2f}) for the projected Barzilai–Borwein method, all steps of the "
        f"active set like H^(−{power['newton']:.2f}); at H = 1/{1 / float(finest['H']):.0f} the last level "
        f"takes {_steps(finest, 'uzawa')}, {_steps(finest, 'nesterov')}, "
        f"{_steps(finest, 'barzilai_borwein')} and {_steps(finest, 'newton')} of them. "
        f"A step with A factorised takes {share[0]:.0f} times the operations of one with S at h = {coarse} "
        f"and {share[-1]:.0f} times at h = {fine}, one with A₃ {of_A_3:.0f} times; after "
        f"{math.ceil(trade.breaks_even(algebra)[-1])} "
        f"steps forming S has paid. In single precision the finest mesh reaches the level {_stop(reached)}, "
        f"and no lower one; with one product in double precision every {REFRESH} steps it reaches them all."
    )
    return textwrap.fill(text, LINE)


def _steps(finest: xr.DataArray, algorithm: str) -> str:
    return f"{int(finest.sel(algorithm=algorithm)):,}".replace(",", " ")


def _stop(stop: float) -> str:
    return f"10^(−{-math.log10(stop):.0f})" if stop < 1 else "1"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %"


def _power(value: float) -> str:
    exponent = math.floor(math.log10(value))
    return f"{value / 10**exponent:.1f}·10^{exponent}"
