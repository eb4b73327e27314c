"""The table of rates: judgements collected, and printed against what was expected."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.formulas.formula import real
from unilateral.problems.case import declared
from unilateral.study import tables
from unilateral.study.rates import JudgedRates, judge_all

INDEX = ["case", "norm", "h_over_H"]
OF_PAIRS = ("h_coarse", "h_fine", "rate", "asymptotic")


def judge_rates(errors: str, name: str, study: Mapping[str, Any], judged: bool, rates: str) -> None:
    """Write and print the rates of a scene, judged as `study`, the table of expected rates, says."""
    table = tables.load(errors)
    asymptotic = {each: declared(each)[0]["asymptotic"] for each in table["case"].values}
    ratio = real(study["judged_ratio"], "judged_ratio")
    found = collect(judge_all(table, study, asymptotic), ratio if judged else None)
    tables.save(found, rates, name, {"rates": study, f"scenes.{name}.judged": judged})
    print(summary(found, ratio))


def collect(
    judgements: Mapping[tuple[str, str, float], JudgedRates], judged_ratio: float | None
) -> xr.Dataset:
    """The table of rates from judgements by (case, norm, h/H), with verdicts at `judged_ratio`, if any."""
    pairs, rows = {}, {}
    for key, found in judgements.items():
        pairs[key] = pd.DataFrame({name: getattr(found, name) for name in OF_PAIRS}, dtype=float)
        expected, judged = found.expected, key[2] == judged_ratio
        rows[key] = {
            "fitted": found.fitted,
            "proved": expected.proved,
            "expected": math.nan if isinstance(expected.rate, str) else expected.rate,
            "finest_error": found.error[-1] if len(found.error) else math.nan,
            "bound": found.bound,
            "verdict": found.verdict if judged else "not judged",
            "why": "; ".join(found.why) if judged else "",
        }
    of_pairs = pd.concat(pairs, names=[*INDEX, "pair"]).sort_index().to_xarray().drop_vars("pair")
    of_rates = pd.DataFrame.from_dict(rows, orient="index").rename_axis(INDEX).sort_index().to_xarray()
    table = xr.merge([of_pairs, of_rates], join="outer")
    variables = {name: each.variable for name, each in table.data_vars.items()}  # before the coordinates
    return xr.Dataset(variables, {name: table[name].variable for name in INDEX})


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
