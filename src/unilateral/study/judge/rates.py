"""Rates and their judgement: one-sided, on every asymptotic pair, with a bound on the finest level.

A rate holds if every pair of asymptotic levels reaches the expected rate less a tolerance, the finest
error lies under a stated bound, and every run that counts converged with a guaranteed algebraic error of
at most a given share of its error in the norm that is judged. In H^{-1/2} rates are those of the r.m.s. mean
of the error's bounds; the lower one meets the share, the upper one the bound on the finest level. An error
whose exact value is 0 has no rate and must be 0 to round-off.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from unilateral.errors import InputError
from unilateral.formulas.formula import real
from unilateral.study.tables import error_in

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]
NORMS = ("h1", "hm12", "l2")
FEWEST_PAIRS = 3
ZERO = 1e-12


@dataclass(frozen=True)
class Expectation:
    """What is expected of a case in a norm, and how it is judged.

    `rate` is None where the exact error is 0, and NaN where nothing is judged, and no level counts; a level
    is asymptotic if h and H times `judged_ratio` are at most `start`; rates compare levels a factor `factor`
    (2 or 4) apart; the finest error may be `bound` times (H ** `power`) times the table's variable
    `reference`.
    """

    proved: float
    rate: float | None
    tolerance: float
    start: float
    factor: int
    reference: str
    power: float
    bound: float
    algebraic_share: float
    judged_ratio: float

    @classmethod
    def of(cls, study: Mapping[str, Any], case: str, norm: str, asymptotic: Mapping[str, Any]) -> Expectation:
        """From the study's table of expected rates and the case's own declaration of its levels.

        Raises InputError for a case that the table lacks.
        """
        if case not in study["cases"]:
            raise InputError(f"the table of expected rates has no case '{case}'; add it there")
        general, special = study["norms"][norm], study["cases"][case][norm]
        bound, where = general["bound"], f"the expected rate of '{case}' in {norm}"
        return cls(
            proved=real(general["proved"], where),
            rate=_rate(special["rate"], where),
            tolerance=real(general["tolerance"], where),
            start=real(asymptotic[norm]["from"], where),
            factor=int(asymptotic[norm].get("factor", 2)),
            reference=bound["reference"],
            power=real(bound.get("power_of_H", 0), where),
            bound=real(bound["factor"], where),
            algebraic_share=real(study["algebraic_share"], where),
            judged_ratio=real(study["judged_ratio"], where),
        )


@dataclass(frozen=True, eq=False)
class Judgement:
    """Levels h, H and their errors (k,); the pairs' h's and rates (p,); the verdict with its reasons."""

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
    why: tuple[str, ...]

    @property
    def verdict(self) -> str:
        if self.expected.rate is None:
            return "fails" if self.why else "exact"
        if math.isnan(self.expected.rate):
            return "not judged"
        return "fails" if self.why else "holds"

    def __str__(self) -> str:
        lines = [f"{'h':>12} {'H':>12} {'error':>12}"]
        lines += [
            f"{h:12.6g} {H:12.6g} {e:12.4e}" for h, H, e in zip(self.h, self.H, self.error, strict=True)
        ]
        lines += [f"{'h':>12} {'to':>12} {'rate':>12}"]
        for a, b, rate, counts in zip(self.h_coarse, self.h_fine, self.rate, self.asymptotic, strict=True):
            lines.append(f"{a:12.6g} {b:12.6g} {rate:12.3f}{'' if counts else '  not asymptotic'}")
        return "\n".join([*lines, f"bound on the finest level {self.bound:.4e}", *self.why, self.verdict])


def judge(table: xr.Dataset, case: str, norm: str, h_over_H: float, expected: Expectation) -> Judgement:
    """The judgement of a case's errors in a norm along a fixed h/H, from the table of a scene."""
    runs = _along(table.sel(case=case), h_over_H)
    h, H, error = runs["h"].values, runs["H"].values, error_in(runs, norm).values
    coarse, fine = _pairs(h, expected.factor)
    with np.errstate(divide="ignore", invalid="ignore"):
        rate = np.log(error[coarse] / error[fine]) / np.log(h[coarse] / h[fine])
    levels = np.maximum(h, H * expected.judged_ratio) <= expected.start * (1 + 1e-9)
    if expected.rate is not None and math.isnan(expected.rate):
        levels = np.zeros_like(levels)
    asymptotic = levels[coarse]
    bound = _bound(runs, expected)
    if expected.rate is None:
        rate, levels = np.full_like(rate, np.nan), np.zeros_like(levels)
        why = _why_not_zero(error_in(runs, norm, "upper").values, runs["u_norm"].values)
    elif math.isnan(expected.rate):
        why = []
    else:
        why = [
            *_why_unfit(runs, norm, levels, expected),
            *_why_slow(rate, asymptotic, h, coarse, expected),
        ]
        finest = error_in(runs, norm, "upper").values[-1] if len(error) else math.nan
        if len(error) and not finest <= bound:
            why.append(f"the finest error {finest:.4g} is above its bound {bound:.4g}")
    fitted = _fit(h[levels], error[levels])
    return Judgement(h, H, error, h[coarse], h[fine], rate, asymptotic, fitted, bound, expected, tuple(why))


def _rate(given: object, where: str) -> float | None:
    if given == "exact":
        return None
    return math.nan if given == "none" else real(given, where)


def _along(table: xr.Dataset, h_over_H: float) -> xr.Dataset:
    """The runs (k,) with that ratio, coarse to fine."""
    mesh, partition = np.nonzero(np.isclose(table["h_over_H"].values, h_over_H, rtol=1e-9))
    order = np.argsort(-table["h"].values[mesh], kind="stable")
    index = {d: xr.DataArray(i[order], dims="run") for d, i in (("mesh", mesh), ("partition", partition))}
    return table.isel(index)


def _pairs(h: Array, factor: int) -> tuple[Index, Index]:
    coarse, fine = np.nonzero(np.isclose(h[:, None], factor * h[None], rtol=1e-9))
    return coarse, fine


def _fit(h: Array, error: Array) -> float:
    if len(h) < 2 or not np.all(error > 0):
        return math.nan
    return float(np.polyfit(np.log(h), np.log(error), 1)[0])


def _bound(runs: xr.Dataset, expected: Expectation) -> float:
    if expected.rate is None or runs.sizes["run"] == 0:
        return math.nan
    finest = runs.isel(run=-1)
    return expected.bound * float(finest["H"]) ** expected.power * float(finest[expected.reference])


def _why_not_zero(error: Array, u_norm: Array) -> list[str]:
    if len(error) and np.all(np.abs(error) <= ZERO * u_norm):
        return []
    return [f"the error should be 0 to {ZERO:g} of ||u||_1"]


def _why_unfit(runs: xr.Dataset, norm: str, levels: Mask, expected: Expectation) -> list[str]:
    """Unconverged or not accurate enough: reasons for which the asymptotic levels cannot be judged."""
    least = error_in(runs, norm, "lower").values
    factor = {
        "h1": np.ones_like(least),
        "hm12": runs["beta_lower"].values,
        "l2": np.sqrt(np.maximum(runs["lambda_min"].values, 0.0)),
    }[norm]
    with np.errstate(divide="ignore", invalid="ignore"):
        algebraic = runs["algebraic_bound"].values / factor
    why = []
    if not np.all(runs["converged"].values[levels] == 1):
        why.append("a run did not converge")
    if not np.all(algebraic[levels] <= expected.algebraic_share * least[levels] * (1 + 1e-9)):
        why.append(f"a guaranteed algebraic error is above {expected.algebraic_share:g} of the error")
    return why


def _why_slow(rate: Array, asymptotic: Mask, h: Array, coarse: Index, expected: Expectation) -> list[str]:
    assert expected.rate is not None
    least = expected.rate - expected.tolerance
    why = []
    if np.count_nonzero(asymptotic) < FEWEST_PAIRS:
        why.append(f"there are fewer than {FEWEST_PAIRS} pairs of asymptotic levels")
    slow = np.flatnonzero(asymptotic & ~(rate >= least))
    why += [f"the rate {rate[i]:.3f} from h = {h[coarse[i]]:.4g} is below {least:.3f}" for i in slow]
    return why


def judge_all(
    table: xr.Dataset, study: Mapping[str, Any], asymptotic: Mapping[str, Mapping[str, Any]]
) -> dict[tuple[str, str, float], Judgement]:
    """The judgements of all cases of a table, in all norms and along all ratios h/H of the study.

    `study` is the table of expected rates; `asymptotic` the declaration of each case.
    """
    return {
        (case, norm, ratio): judge(
            table, case, norm, ratio, Expectation.of(study, case, norm, asymptotic[case])
        )
        for case in map(str, table["case"].values)
        for norm in NORMS
        for ratio in (real(ratio, "ratios") for ratio in study["ratios"])
    }
