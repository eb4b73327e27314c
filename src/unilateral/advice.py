"""What the study of cost lets recommend, for readers: tables and sentences whose numbers are the results'."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence

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


def advice(crossed: xr.Dataset, cases: xr.Dataset, H_over_h: float, coarsest: float) -> str:
    """A Markdown table: per norm what to use, what it reaches and costs; and when that stop is not enough."""
    chosen = {norm: trade.choice(crossed, cases, norm, H_over_h, coarsest) for norm in NORMS}
    lines = [
        f"| for the error of | H/h | error at {H_over_h:g} | stop at | at H = {H_over_h:g}h: relative error |"
        f" at h | operations | half of it costs | {' | '.join(NAMES[name] for name in COMPARED)} |",
        "|---" * (8 + len(COMPARED)) + "|",
    ]
    for norm, of in chosen.items():
        cells = [
            TITLES[norm],
            _close(of.losses),
            f"+{100 * (of.losses[H_over_h] - 1):.0f} %",
            _stop(of.stop),
            _percent(of.error),
            f"1/{1 / of.h:.0f}",
        ]
        cells += [_power(of.operations), f"× {of.halving:.1f}"]
        cells += [f"{of.of_algorithms[name]:.2f}" for name in COMPARED]
        lines.append(f"| {' | '.join(cells)} |")
    lowest = min(chosen.values(), key=lambda of: of.stop)
    least, most = (choose(lowest.losses) for choose in (min, max))
    worst = float(trade.excess(cases.sel(H=cases["H"] <= coarsest), "hm12").sel(stop=chosen["h1"].stop).max())
    text = (
        f"H/h: the ratios whose error at the same work, a mean over {len(cases['case'])} cases, is within "
        f"{100 * (trade.CLOSE - 1):.0f} % of the best of those from {least:g} to {most:g}, and what is lost "
        f"at {H_over_h:g}, which `--accuracy` takes; ratios below 2 are outside the stability rule above. "
        f"The stop is a guaranteed algebraic error, as a part of ‖u−u_h‖₁; it leaves no error of any case, "
        f"at any H/h, above {trade.ENOUGH:g} times that of the discrete solution. "
        f"What is enough for u is not for λ: at {_stop(chosen['h1'].stop)} the error of λ in H^(−1/2) is "
        f"up to {worst:.1f} times as large as it could be. "
        f"The lower level is that of {_cases(lowest.set_by)}; for the other cases "
        f"{_stop(lowest.stop_elsewhere)} would do. "
        f"The last {len(COMPARED)} columns give each algorithm's operations, "
        f"set-up included, over those of the cheapest; differences below 5 % mean nothing. "
        f"`--accuracy`, and for a case the default stop, do this for you."
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


def halving(
    cases: xr.Dataset, scenes: xr.Dataset, crossed: xr.Dataset, H_over_h: float, coarsest: float
) -> str:
    """A Markdown table: the factor of work for half of the error; plain Uzawa, each enough stop."""
    chosen = {norm: trade.choice(crossed, cases, norm, H_over_h, coarsest) for norm in NORMS}
    rows = {f"`{name}`": cases.sel(case=name, H_over_h=H_over_h) for name in cases["case"].values}
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
    power = {name: trade.growth(crossed, name, H_over_h, coarsest) for name in ("uzawa", "nesterov")}
    last = crossed["steps"].sel(H_over_h=H_over_h).sel(stop=trade.SHOWN, method="nearest")
    finest = last.dropna("H").isel(H=-1)
    step = {name: algebra["step_operations"].sel(algebra=name).values for name in ("A", "A_3", "S")}
    share, of_A_3 = step["A"] / step["S"], step["A_3"][-1] / step["S"][-1]
    coarse, fine = (f"1/{1 / h:.0f}" for h in algebra["h"].sel(algebra="S").values[[0, -1]])
    single = precision["steps"].sel(precision="float32").isel(H=-1)
    reached = float(single["stop"][int(np.flatnonzero(np.isfinite(single.values))[-1])])
    per_step = precision["step_operations"].isel(H=-1)
    dearer = float(per_step.sel(precision="refined") / per_step.sel(precision="float64"))
    text = (
        f"At H = {H_over_h:g}h the steps for the last five digits grow like "
        f"H^(−{power['uzawa']:.1f}) for Uzawa's algorithm and H^(−{power['nesterov']:.1f}) for Nesterov's, "
        f"with the transition at another place in its cell on each level. "
        f"At H = 1/{1 / float(finest['H']):.0f} the level {_stop(trade.SHOWN)} takes about "
        f"{_steps(finest, 'uzawa')} and {_steps(finest, 'nesterov')} "
        f"steps, the projected Barzilai–Borwein method {_steps(finest, 'barzilai_borwein')}, the active set "
        f"{_steps(finest, 'newton')}. Further down the steps of Barzilai–Borwein depend on rounding; "
        f"no more is said of them. "
        f"A step with A factorised takes {share[0]:.0f} times the operations of one with S at h = {coarse} "
        f"and {share[-1]:.0f} times at h = {fine}, one with A₃ {of_A_3:.0f} times; after "
        f"{math.ceil(trade.breaks_even(algebra)[-1])} "
        f"steps forming S has paid (without the spectrum, of which the guaranteed stop needs λ_min whatever "
        f"the matrix). In single precision the finest mesh reaches the level {_stop(reached)}, "
        f"and no lower one; with one product in double precision every {REFRESH} steps, "
        f"{100 * (dearer - 1):.1g} % more operations a step, it reaches them all. "
        f"The time that single precision saves is not measured here."
    )
    return textwrap.fill(text, LINE)


def _steps(finest: xr.DataArray, algorithm: str) -> str:
    """In two digits."""
    return f"{float(f'{float(finest.sel(algorithm=algorithm)):.2g}'):,.0f}".replace(",", " ")


def _close(losses: Mapping[float, float]) -> str:
    """The ratios within CLOSE of the best one."""
    good = [ratio for ratio, loss in losses.items() if loss <= trade.CLOSE]
    return f"{min(good):g}" if len(good) == 1 else f"{min(good):g} to {max(good):g}"


def _cases(names: Sequence[str]) -> str:
    return " and ".join(f"`{name}`" for name in names)


def _stop(stop: float) -> str:
    return f"10^(−{-math.log10(stop):.0f})" if stop < 1 else "1"


def _percent(value: float) -> str:
    return f"{100 * value:.2g} %"


def _power(value: float) -> str:
    exponent = math.floor(math.log10(value))
    return f"{value / 10**exponent:.1f}·10^{exponent}"
