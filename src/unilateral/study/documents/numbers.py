"""The named numbers of the documents, raw: the study's parameters, its claims, and what its tables say."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from unilateral.formulas.formula import real
from unilateral.norms.resolution import RULE
from unilateral.study.documents.sources import Sources
from unilateral.study.experiments.adaptive import numbers as adaptive
from unilateral.study.experiments.benchmarks import commands
from unilateral.study.experiments.benchmarks import numbers as benchmarks
from unilateral.study.experiments.cost import numbers as cost
from unilateral.study.experiments.cost import trade
from unilateral.study.experiments.extremes import numbers as extremes
from unilateral.study.experiments.scenes import numbers as scenes
from unilateral.study.experiments.sharpness import numbers as sharpness
from unilateral.study.experiments.stability import numbers as stability
from unilateral.study.formats import Value
from unilateral.study.ledger.records import ORIGINS, origin


def collect(told: Sources) -> dict[str, Value]:
    """All numbers by name."""
    of, H_over_h, coarsest = told.tables, told.H_over_h, told.coarsest
    return flat(
        {
            "study": {**told.study, "infsup": {"rule": RULE._asdict()}},
            "claims": {each["id"]: {"observed": each["observed"]} for each in told.claims}
            | ledger(told.claims),
            "beta": stability.beta(told.pairs, *RULE)
            | stability.uniform_beta(told.pairs)
            | stability.inner_nodes(told.pairs),
            "theorems": sharpness.theorems({each["id"]: each["observed"] for each in told.claims}),
            "cost": cost.recommended(of["case"], H_over_h, coarsest)
            | {
                "enough_times": trade.ENOUGH,
                "newton_adds": cost.newton_adds(of["algorithm"], H_over_h),
                "plain": cost.plain(of["algorithm"], H_over_h),
                "growth": cost.growth(of["algorithm"], coarsest),
                "elimination": cost.elimination(of["algorithm"], of["algebra"], H_over_h),
                "precision": cost.in_precision(of["precision"]),
            },
            "totals": scenes.totals_of_corners(told.totals["corners"]),
            "adapted": adaptive.beta(of["adapted_beta"], RULE.smallest_angle),
            "extremes": extremes.outcomes(of["extremes"]),
            "benchmarks": benchmarks.numbers(of["benchmarks"]),
            "commands": commands.numbers(told.commands),
            "scores": {name: real(told.scores[name].iloc[0], name) for name in ("h", "H")},
            "whole": {"cores": told.whole["cores"]}
            | {name: taken(told.whole[name]) for name in ("solver", "study", "tests")},
        }
    )


def ledger(claims: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many claims have a check and how many have none, and where the required numbers come from."""
    origins = Counter(origin(each["source"]) for each in claims if each["source"] is not None)
    known = {"all": origins.total(), "unmeasured": len(claims) - origins.total()}
    return known | {"thresholds": {name: origins[name] for name in ORIGINS}}


def taken(measured: Mapping[str, float]) -> dict[str, Any]:
    """Minutes, and GB of memory and of the disk, from seconds and MB."""
    sizes = {name: measured[name] / 1024 for name in ("memory", "disk") if name in measured}
    return {"minutes": measured["seconds"] / 60, **sizes}


def flat(groups: Mapping[str, Any], above: str = "") -> dict[str, Value]:
    """{"a": {"b": 1, "c": [2]}} as {"a.b": 1}: names lead through the groups, and lists are left out."""
    found: dict[str, Value] = {}
    for name, of in groups.items():
        if isinstance(of, Mapping):
            found |= flat(of, f"{above}{name}.")
        elif isinstance(of, Value):
            found[f"{above}{name}"] = of
    return found
