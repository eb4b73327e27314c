"""Rates, judged one-sided on every asymptotic pair, with a bound on the finest level; and their table.

A rate holds if every pair of asymptotic levels reaches the expected rate less a tolerance, and the finest
error lies under a stated bound. It is judged only if every run that counts converged with a guaranteed
algebraic error of at most a given share of its error in the norm that is judged. In H^{-1/2} rates are those
of the r.m.s. mean of the error's bounds; the share is one of the lower bound, and the upper bound has to lie
under that on the finest level. An error whose exact value is 0 has no rate and must be 0 to round-off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
import xarray as xr

from study import tables
from study.tables import ERROR_NORMS, ZERO_ERROR_SHARE, error_in_norm, select_ratio
from unilateral.arrays import Array, Mask
from unilateral.errors import InputError
from unilateral.formulas.formula import parse_real
from unilateral.problems.case import read_case_declaration

RateVerdict = Literal["holds", "fails", "exact", "not judged"]
Reasons = tuple[str, ...]
RATE_INDEX = ["case", "norm", "h_over_H"]
PAIR_FIELDS = ("h_coarse", "h_fine", "rate", "asymptotic")
MIN_PAIRS = 3


@dataclass(frozen=True)
class Expectation:
    """What is expected of a case in a norm, and how it is judged.

    `rate` is "exact" where the exact error is 0, and "none" where nothing is judged and no level counts. A
    level is asymptotic if h, and H times `judged_ratio`, are at most `start`. Rates compare levels a factor
    `factor` (2 or 4) apart. The finest error may be `bound` times (H ** `power`) times the table's variable
    `reference`.
    """

    proved: float
    rate: float | Literal["exact", "none"]
    tolerance: float
    start: float
    factor: int
    reference: str
    power: float
    bound: float
    algebraic_share: float
    judged_ratio: float

    @classmethod
    def read(
        cls, study: Mapping[str, Any], case: str, norm: str, asymptotic: Mapping[str, Any]
    ) -> Expectation:
        """The expectation by the study's table of rates and the case's own declaration of its levels.

        Raises InputError for a case that the table lacks.
        """
        if case not in study["cases"]:
            raise InputError(f"the table of expected rates has no case '{case}'; add it there")
        general = study["norms"][norm]
        case_rates = study["cases"][case][norm]
        rate = case_rates["rate"]
        bound = general[case_rates.get("judged_by", "bound")]
        where = f"the expected rate of '{case}' in {norm}"
        return cls(
            proved=parse_real(general["proved"], where),
            rate=rate if rate in ("exact", "none") else parse_real(rate, where),
            tolerance=parse_real(general["tolerance"], where),
            start=parse_real(asymptotic[norm]["from"], where),
            factor=int(asymptotic[norm].get("factor", 2)),
            reference=bound["reference"],
            power=parse_real(bound.get("power_of_H", 0), where),
            bound=parse_real(bound["factor"], where),
            algebraic_share=parse_real(study["algebraic_share"], where),
            judged_ratio=parse_real(study["judged_ratio"], where),
        )

    @property
    def required_rate(self) -> float:
        """The rate that has to be reached, NaN where none is expected."""
        return math.nan if isinstance(self.rate, str) else self.rate - self.tolerance


@dataclass(frozen=True, eq=False)
class JudgedRates:
    """Levels h, H and their errors (k,); the pairs' h's and rates (p,); the verdict with its reasons.

    `reasons_unfit` says why the runs cannot be judged, `reasons_against` what speaks against the expected
    rate.
    """

    h: Array
    H: Array
    error: Array
    h_coarse: Array
    h_fine: Array
    rate: Array
    asymptotic: Mask
    fitted: float
    bound: float
    expected: Expectation
    reasons_unfit: Reasons
    reasons_against: Reasons

    @property
    def reasons(self) -> Reasons:
        """The reasons for which a rate does not hold."""
        return self.reasons_unfit + self.reasons_against

    @property
    def verdict(self) -> RateVerdict:
        """Verdict on the expected rate: holds, fails, exact or not judged."""
        if self.reasons_unfit or self.expected.rate == "none":
            return "not judged"
        if self.reasons_against:
            return "fails"
        return "exact" if self.expected.rate == "exact" else "holds"


def judge_errors(
    table: xr.Dataset, case: str, norm: str, h_over_H: float, expected: Expectation
) -> JudgedRates:
    """The judgement of a case's errors in a norm along a fixed h/H, from the table of a scene."""
    runs = select_ratio(table.sel(case=case), h_over_H)
    h = runs["h"].values
    H = runs["H"].values
    error = error_in_norm(runs, norm).values
    coarse, fine = np.nonzero(np.isclose(h[:, None], expected.factor * h[None], rtol=1e-9))
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.log(error[coarse] / error[fine]) / np.log(h[coarse] / h[fine])
    # A level is asymptotic if h and H times the judged ratio are at most the case's start, up to rounding
    levels = np.maximum(h, H * expected.judged_ratio) <= expected.start * (1 + 1e-9)
    unfit: Reasons = ()
    against: Reasons = ()
    if expected.rate == "exact":
        rate = np.full_like(rate, np.nan)
        against = _why_not_zero(runs, norm)
    elif expected.rate == "none":
        levels = np.zeros_like(levels)
    else:
        unfit = _why_unfit(runs, norm, levels, expected)
        against = _why_slow(rate, levels[coarse], h[coarse], expected) + _why_large(runs, norm, expected)
    fitted = math.nan if expected.rate == "exact" else _fit_rate(h[levels], error[levels])
    return JudgedRates(
        h=h,
        H=H,
        error=error,
        h_coarse=h[coarse],
        h_fine=h[fine],
        rate=rate,
        asymptotic=levels[coarse],
        fitted=fitted,
        bound=_finest_error_bound(runs, expected),
        expected=expected,
        reasons_unfit=unfit,
        reasons_against=against,
    )


def _fit_rate(h: Array, error: Array) -> float:
    if len(h) < 2 or not np.all(error > 0):
        return math.nan
    return float(np.polyfit(np.log(h), np.log(error), 1)[0])


def _finest_error_bound(runs: xr.Dataset, expected: Expectation) -> float:
    """The stated bound on the finest error; NaN where the exact error is 0, or without runs."""
    if expected.rate == "exact" or runs.sizes["run"] == 0:
        return math.nan
    finest = runs.isel(run=-1)
    return expected.bound * float(finest["H"]) ** expected.power * float(finest[expected.reference])


def _why_not_zero(runs: xr.Dataset, norm: str) -> Reasons:
    error = error_in_norm(runs, norm, "upper").values
    if len(error) and np.all(np.abs(error) <= ZERO_ERROR_SHARE * runs["u_norm"].values):
        return ()
    return (f"the error should be 0 to {ZERO_ERROR_SHARE:g} of ||u||_1",)


def _why_unfit(runs: xr.Dataset, norm: str, levels: Mask, expected: Expectation) -> Reasons:
    """Why the asymptotic levels cannot be judged: a run did not converge, or is not accurate enough."""
    lower_bounds = error_in_norm(runs, norm, "lower").values
    reasons = []
    # ||mu||_{-1/2,h} is at least beta ||mu||_{-1/2}, by (3.4), and at least lambda_min(S)^{1/2} ||mu||_0
    factor = {
        "h1": np.ones_like(lower_bounds),
        "hm12": runs["beta_lower"].values,
        "l2": np.sqrt(np.maximum(runs["lambda_min"].values, 0.0)),
    }[norm]
    with np.errstate(divide="ignore", invalid="ignore"):
        algebraic = runs["algebraic_bound"].values / factor
    if not np.all(runs["converged"].values[levels] == 1):
        reasons.append("a run did not converge")
    if not np.all(algebraic[levels] <= expected.algebraic_share * lower_bounds[levels] * (1 + 1e-9)):
        reasons.append(f"a guaranteed algebraic error is above {expected.algebraic_share:g} of the error")
    return tuple(reasons)


def _why_slow(rate: Array, asymptotic: Mask, h_coarse: Array, expected: Expectation) -> Reasons:
    reasons = []
    if np.count_nonzero(asymptotic) < MIN_PAIRS:
        reasons.append(f"there are fewer than {MIN_PAIRS} pairs of asymptotic levels")
    slow = np.flatnonzero(asymptotic & ~(rate >= expected.required_rate))
    reasons += [
        f"the rate {rate[i]:.3f} from h = {h_coarse[i]:.4g} is below {expected.required_rate:.3f}"
        for i in slow
    ]
    return tuple(reasons)


def _why_large(runs: xr.Dataset, norm: str, expected: Expectation) -> Reasons:
    if runs.sizes["run"] == 0:
        return ()
    finest = error_in_norm(runs, norm, "upper").values[-1]
    bound = _finest_error_bound(runs, expected)
    return () if finest <= bound else (f"the finest error {finest:.4g} is above its bound {bound:.4g}",)


def judge_rates(errors: str, name: str, study: Mapping[str, Any], judged: bool, rates: str) -> None:
    """Write and print the rates of a scene, judged as `study`, the table of expected rates, says."""
    table = tables.load_table(errors)
    judgements = {}
    for case in map(str, table["case"].values):
        asymptotic = read_case_declaration(case)[0]["asymptotic"]
        for norm in ERROR_NORMS:
            expected = Expectation.read(study, case, norm, asymptotic)
            for ratio in (parse_real(ratio, "ratios") for ratio in study["ratios"]):
                judgements[case, norm, ratio] = judge_errors(table, case, norm, ratio, expected)
    judged_ratio = parse_real(study["judged_ratio"], "judged_ratio")
    collected = tabulate_judgements(judgements, judged_ratio if judged else None)
    tables.save_table(collected, rates, name, {"rates": study, f"scenes.{name}.judged": judged})
    print(summarise_rates(collected, judged_ratio))


def tabulate_judgements(
    judgements: Mapping[tuple[str, str, float], JudgedRates], judged_ratio: float | None
) -> xr.Dataset:
    """The table of rates from judgements by (case, norm, h/H), with verdicts at `judged_ratio`, if any."""
    pairs = {}
    rows = {}
    for key, judgement in judgements.items():
        pairs[key] = pd.DataFrame({name: getattr(judgement, name) for name in PAIR_FIELDS}, dtype=float)
        expected = judgement.expected
        judged = key[2] == judged_ratio
        rows[key] = {
            "fitted": judgement.fitted,
            "proved": expected.proved,
            "expected": math.nan if isinstance(expected.rate, str) else expected.rate,
            "finest_error": judgement.error[-1] if len(judgement.error) else math.nan,
            "bound": judgement.bound,
            "verdict": judgement.verdict if judged else "not judged",
            "why": "; ".join(judgement.reasons) if judged else "",
        }
    pair_table = pd.concat(pairs, names=[*RATE_INDEX, "pair"]).sort_index().to_xarray().drop_vars("pair")
    rate_table = pd.DataFrame.from_dict(rows, orient="index").rename_axis(RATE_INDEX).sort_index().to_xarray()
    table = xr.merge([pair_table, rate_table], join="outer")
    variables = {name: array.variable for name, array in table.data_vars.items()}  # before the coordinates
    return xr.Dataset(variables, {name: table[name].variable for name in RATE_INDEX})


def summarise_rates(rates: xr.Dataset, ratio: float) -> str:
    """Observed against expected rates at one h/H, a line per case and norm."""
    lines = [f"{'case':15} {'norm':5} {'proved':>7} {'expected':>9} {'smallest':>9} {'fitted':>7}  verdict"]
    for case in rates["case"].values:
        for norm in rates["norm"].values:
            row = rates.sel(case=case, norm=norm, h_over_H=ratio)
            numbers = f"{row.proved.item():7.3g} {row.expected.item():9.3g} {smallest_rate(row):9.3f}"
            verdict = f"{row.fitted.item():7.3f}  {row.verdict.item()} {row.why.item()}"
            lines.append(f"{case:15} {norm:5} {numbers} {verdict}".rstrip())
    return "\n".join(lines)


def smallest_rate(rates_row: xr.Dataset) -> float:
    """The smallest rate of the asymptotic pairs in one row of the table of rates; NaN if there is none."""
    rates = rates_row["rate"].values[rates_row["asymptotic"].values == 1]
    return float(np.min(rates)) if len(rates) else math.nan
