"""The table of rates: judgements collected, and printed against what was expected."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import xarray as xr

from unilateral.study.judge.rates import Judgement


def collect(judgements: Mapping[tuple[str, str, float], Judgement], judged_ratio: float | None) -> xr.Dataset:
    """The table of rates from judgements by (case, norm, h/H); verdicts at one h/H, or at none."""
    cases, norms, ratios = (sorted({key[i] for key in judgements}) for i in range(3))
    longest = max(len(j.rate) for j in judgements.values())
    index, pairs = ("case", "norm", "h_over_H"), ("case", "norm", "h_over_H", "pair")
    shape = (len(cases), len(norms), len(ratios))
    table = xr.Dataset(
        {
            name: (pairs, np.full((*shape, longest), np.nan))
            for name in ("h_coarse", "h_fine", "rate", "asymptotic")
        }
        | {
            name: (index, np.full(shape, np.nan))
            for name in ("fitted", "proved", "expected", "finest_error", "bound")
        }
        | {name: (index, np.full(shape, "", dtype=object)) for name in ("verdict", "why")},
        coords={"case": cases, "norm": norms, "h_over_H": ratios},
    )
    for (case, norm, ratio), found in judgements.items():
        at = (cases.index(case), norms.index(norm), ratios.index(ratio))
        for name in ("h_coarse", "h_fine", "rate", "asymptotic"):
            table[name][(*at, slice(len(found.rate)))] = getattr(found, name)
        values = {
            "fitted": found.fitted,
            "proved": found.expected.proved,
            "expected": math.nan if found.expected.rate is None else found.expected.rate,
            "finest_error": found.error[-1] if len(found.error) else math.nan,
            "bound": found.bound,
            "verdict": found.verdict if ratio == judged_ratio else "not judged",
            "why": "; ".join(found.why) if ratio == judged_ratio else "",
        }
        for name, value in values.items():
            table[name][at] = value
    return table


def summary(found: xr.Dataset, ratio: float) -> str:
    """Observed against expected rates at one h/H, a line per case and norm."""
    lines = [f"{'case':15} {'norm':5} {'proved':>7} {'expected':>9} {'smallest':>9} {'fitted':>7}  verdict"]
    for case in found["case"].values:
        for norm in found["norm"].values:
            of = found.sel(case=case, norm=norm, h_over_H=ratio)
            smallest = smallest_rate(of)
            numbers = (
                f"{float(of.proved):7.3g} {float(of.expected):9.3g} {smallest:9.3f} {float(of.fitted):7.3f}"
            )
            lines.append(f"{case:15} {norm:5} {numbers}  {of.verdict.item()} {of.why.item()}".rstrip())
    return "\n".join(lines)


def smallest_rate(of: xr.Dataset) -> float:
    """The smallest rate of the asymptotic pairs in one row of the table of rates; NaN if there is none."""
    rates = of["rate"].values[of["asymptotic"].values == 1]
    return float(np.min(rates)) if len(rates) else math.nan
