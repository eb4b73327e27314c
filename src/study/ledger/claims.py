"""The ledger: every statement of the paper, a check on the study's results, and a verdict.

An experiment declares its claims in `claims.yaml`. What is observed is there an expression over its tables,
see `ledger.checks`, or a function in the experiment's `checks`. A check gives an observed number and the one
it has to reach or to stay below; its margin is what is left, relative to the latter. A claim whose margin is
not negative gets the verdict that the ledger declares for that case, any other one fails. Where a
precondition of the check does not hold the claim is not judged, for that reason, and does not hold either. A
control is a spoilt result on which the check has to fail; the smallest share of it at which it does is how
small an error the check sees. A statement that no number can refute is declared with the reason, and has no
check.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from study.evidence import Evidence, Tables, Unjudged
from study.experiments.adaptive import checks as adaptive
from study.experiments.algorithm import checks as algorithm
from study.experiments.cells import checks as cells
from study.experiments.cost import checks as cost
from study.experiments.estimates import checks as estimates
from study.experiments.extremes import checks as extremes
from study.experiments.graded import checks as graded
from study.experiments.scenes import checks as scenes
from study.experiments.sharpness import checks as sharpness
from study.experiments.stability import checks as stability
from study.ledger import checks
from study.ledger.controls import describe_share, find_smallest_share, spoil_results
from study.ledger.entries import read_entries
from study.ledger.listing import list_claims
from study.ledger.records import FAILS, ORIGINS, UNJUDGED, UNMEASURED, verdict_counts_against
from study.ledger.results import Results
from unilateral.errors import InputError, quote_input, suggest_name
from unilateral.system.files import replacing

CHECK_MODULES = {
    "ledger": checks,
    "adaptive": adaptive,
    "algorithm": algorithm,
    "cells": cells,
    "cost": cost,
    "estimates": estimates,
    "extremes": extremes,
    "graded": graded,
    "scenes": scenes,
    "sharpness": sharpness,
    "stability": stability,
}
"""Where checks are: those that serve several experiments, and those of each experiment."""


@dataclass(frozen=True)
class Claim:
    """A statement: where it stands, what the study says if the check passes, and how it is checked.

    `title` says it in a few words, for figures; `section` is where this study reports it; `reads` names
    the tables it depends on; `source` is where the required number comes from; `control` spoils a table.
    Where there is nothing to measure, `unmeasured` says why, and the claim has no verdict, check or control.
    """

    id: str
    section: str
    title: str
    statement: str
    where: str
    verdict: str = ""
    check: str = ""
    parameters: Mapping[str, Any] = field(default_factory=dict)
    reads: tuple[str, ...] = ()
    source: str = ""
    control: Mapping[str, Any] = field(default_factory=dict)
    unmeasured: str = ""

    def measure(self, results: Tables) -> Evidence:
        """The check's evidence. Raises Unjudged, and InputError for a table that is missing."""
        experiment, function = self.check.split(".")
        evidence: Evidence = getattr(CHECK_MODULES[experiment], function)(results, **self.parameters)
        return evidence


@dataclass(frozen=True)
class Judgement:
    """A claim, the results it was judged by, and the evidence, or why there is none."""

    claim: Claim
    results: Results
    evidence: Evidence | Unjudged | None

    @property
    def holds(self) -> bool:
        """Whether there is evidence and it holds."""
        return isinstance(self.evidence, Evidence) and self.evidence.holds

    @property
    def counts_against(self) -> bool:
        """Whether there is something to measure and it does not hold."""
        return verdict_counts_against(self.verdict)

    @property
    def verdict(self) -> str:
        """The claim's verdict if it holds, else that it fails, is not judged, or has nothing to measure."""
        if self.evidence is None:
            return f"{UNMEASURED}: {self.claim.unmeasured}"
        if isinstance(self.evidence, Unjudged):
            return f"{UNJUDGED}: {self.evidence}"
        return self.claim.verdict if self.holds else FAILS

    @cached_property
    def sees(self) -> str | None:
        """The smallest part of its control at which the claim does not hold; None if it fails anyway."""
        if not self.holds:
            return None
        control = self.claim.control
        claim = _restrict_to_control(self.claim)
        if not judge_claim(self.results, claim).holds:  # nothing to judge on these alone
            claim = self.claim
        share = find_smallest_share(
            lambda x: not judge_claim(spoil_results(self.results, control, x), claim).holds
        )
        return describe_share(control, share)

    def record(self) -> dict[str, Any]:
        """The claim's record in `results/claims.json`; without numbers if there are none."""
        claim = self.claim
        record: dict[str, Any] = {
            "id": claim.id,
            "section": claim.section,
            "title": claim.title,
            "statement": claim.statement,
            "where": claim.where,
            "scene": sorted({name.split("/")[0] for name in claim.reads}),
            "quantity": None,
            "expected": None,
            "source": claim.source or None,
            "observed": None,
            "margin": None,
            "verdict": self.verdict,
            "control": claim.control.get("what"),
            "sees": self.sees,
        }
        if isinstance(self.evidence, Evidence):
            sign = ">=" if self.evidence.is_minimum else "<="
            record["quantity"] = self.evidence.quantity
            record["expected"] = f"{sign} {self.evidence.required:.4g}"
            record["observed"] = float(f"{self.evidence.observed:.4g}")
            record["margin"] = float(f"{self.evidence.margin:.2g}")
        return record


@cache
def load_ledger() -> tuple[Claim, ...]:
    """All claims, section by section. Raises InputError for an entry that is none."""
    return tuple(read_claim(entry) for entry in read_entries())


CLAIM_FIELDS = frozenset({"verdict", "check", "reads", "source", "control"}), frozenset({"unmeasured"})
"""Besides id, section, title, statement and where, a claim has the first fields or, unmeasured, the last."""


def read_claim(entry: Mapping[str, Any]) -> Claim:
    """The claim of an entry. Raises InputError for fields too few or too many, and for an unknown check."""
    parameters = entry.get("parameters", {})
    scenes = parameters.get("scenes", [""])
    reads = [name.format(scene=scene) for name in entry.get("reads", ()) for scene in scenes]
    fields = {**entry, "parameters": parameters, "reads": tuple(dict.fromkeys(reads))}
    try:
        claim = Claim(**fields)
    except TypeError as error:
        raise InputError(f"ledger, claim '{entry['id']}': {error}") from None
    if entry.keys() & frozenset.union(*CLAIM_FIELDS) not in CLAIM_FIELDS:
        raise InputError(
            f"ledger, claim '{claim.id}': it needs {', '.join(sorted(CLAIM_FIELDS[0]))}, "
            "or 'unmeasured' alone"
        )
    if claim.check and claim.source.partition(":")[0] not in ORIGINS.values():
        origins = ", ".join(f"'{origin}'" for origin in ORIGINS.values())
        raise InputError(
            f"ledger, claim '{claim.id}': its source has to begin with one of {origins}, and a colon"
        )
    experiment, _, function = claim.check.partition(".")
    if claim.check and not hasattr(CHECK_MODULES.get(experiment), function):
        raise InputError(f"ledger, claim '{claim.id}': there is no check '{claim.check}'")
    return claim


def _restrict_to_control(claim: Claim) -> Claim:
    """The claim about those of its scenes that its control spoils: a check fails where one scene does."""
    touched = {name.split("/")[0] for name in claim.control["tables"]}
    if not (scenes := [scene for scene in claim.parameters.get("scenes", ()) if scene in touched]):
        return claim
    return replace(claim, parameters={**claim.parameters, "scenes": scenes})


def judge_claims(tables: Sequence[str], claims: str) -> None:
    """Write and print the judgements of all claims, by the tables that lie in folders beside their file."""
    records = [judgement.record() for judgement in judge_all(Results(Path(claims).parent))]
    with replacing(claims) as temporary:
        temporary.write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    print(*list_claims(records), sep="\n")


def judge_all(results: Results, claims: Iterable[Claim] | None = None) -> list[Judgement]:
    """The claims' judgements by those tables."""
    return [judge_claim(results, claim) for claim in claims or load_ledger()]


def judge_claim(results: Results, claim: Claim) -> Judgement:
    """The judgement of one claim by those tables."""
    if claim.unmeasured:
        return Judgement(claim, results, None)
    try:
        return Judgement(claim, results, claim.measure(results))
    except Unjudged as reason:
        return Judgement(claim, results, reason)


def find_claim(claim_id: str) -> Claim:
    """The claim with that id. Raises InputError if there is none."""
    claims_by_id = {claim.id: claim for claim in load_ledger()}
    if claim_id not in claims_by_id:
        raise InputError(
            f"there is no claim '{quote_input(claim_id)}'{suggest_name(claim_id, claims_by_id)}; "
            "'unilateral claims' lists them all"
        )
    return claims_by_id[claim_id]
