"""The ledger: every statement of the paper, a check on the study's results, and a verdict.

The statements are declared in `ledger`, in a file for each section; `checks` holds what is measured. A check
gives an observed number and the one it has to reach or to stay below; its margin is what is left, relative
to the latter. A claim whose margin is not negative gets the verdict that the ledger declares for that case,
any other one fails. Where a precondition of the check does not hold the claim is not judged, for that
reason, and does not hold either. A control is a spoilt result on which the check has to fail.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import xarray as xr

from unilateral.errors import InputError
from unilateral.study.judge.checks import (
    adaptive,
    algorithm,
    cost,
    estimates,
    extremes,
    rates,
    stability,
    transitions,
)
from unilateral.study.judge.checks.evidence import Evidence, Tables, Unjudged
from unilateral.study.judge.ledger import entries
from unilateral.study.judge.records import FAILS, UNJUDGED
from unilateral.study.tables import load

LETTERS = {
    r"\frac12": "1/2 ", r"\partial ": "∂", r"\lambda": "λ", r"\mu": "μ", r"\beta": "β", r"\rho": "ρ",
    r"\sigma": "σ", r"\alpha": "α", r"\varepsilon": "ε", r"\Pi": "Π", r"\langle": "<", r"\rangle": ">",
    r"\|": "‖", r"\le ": "<= ", r"\ge ": ">= ", r"\sim": "~", r"\inf": "inf", r"\in ": "in ",
    r"\sup": "sup", r"\coth": "coth ", r"\max": "max", r"\min": "min", r"\log": "log", r"\gamma": "γ",
    r"\tau": "τ", r"\Omega": "Ω", r"\Lambda": "Λ", r"\times": "×", r"\cdot": "·", r"\,": " ", "$": "",
}  # fmt: skip
CHECKS = {
    "adaptive": adaptive,
    "algorithm": algorithm,
    "cost": cost,
    "estimates": estimates,
    "extremes": extremes,
    "rates": rates,
    "stability": stability,
    "transitions": transitions,
}


class Results(dict[str, xr.Dataset]):
    """The tables below a folder by name, such as "square/errors", read when they are asked for."""

    def __init__(self, folder: str | Path, tables: Mapping[str, xr.Dataset] | None = None) -> None:
        super().__init__(tables or {})
        self.folder = Path(folder)

    def __missing__(self, name: str) -> xr.Dataset:
        self[name] = load(self.folder / f"{name}.nc")
        return self[name]


@dataclass(frozen=True)
class Claim:
    """A statement: where it stands, what the study says if the check passes, and how it is checked.

    `title` says it in a few words, for figures; `section` is where this study reports it; `reads` names
    the tables it depends on; `control` spoils one.
    """

    id: str
    section: str
    title: str
    statement: str
    where: str
    verdict: str
    check: str
    parameters: Mapping[str, Any]
    reads: tuple[str, ...]
    source: str
    control: Mapping[str, Any]

    def measure(self, results: Tables) -> Evidence:
        """The check's evidence. Raises Unjudged, and InputError for a table that is missing."""
        module, function = self.check.split(".")
        evidence: Evidence = getattr(CHECKS[module], function)(results, **self.parameters)
        return evidence


@dataclass(frozen=True)
class Judgement:
    """A claim with the evidence, or with why there is none."""

    claim: Claim
    evidence: Evidence | Unjudged

    @property
    def holds(self) -> bool:
        return isinstance(self.evidence, Evidence) and self.evidence.holds

    @property
    def verdict(self) -> str:
        if isinstance(self.evidence, Unjudged):
            return f"{UNJUDGED}: {self.evidence}"
        return self.claim.verdict if self.holds else FAILS

    def record(self) -> dict[str, Any]:
        """What `results/claims.json` holds of a claim; without numbers if it is not judged."""
        claim = self.claim
        record = {
            "id": claim.id,
            "section": claim.section,
            "title": claim.title,
            "statement": claim.statement,
            "where": claim.where,
            "scene": sorted({name.split("/")[0] for name in claim.reads}),
            "quantity": None,
            "expected": None,
            "source": claim.source,
            "observed": None,
            "margin": None,
            "verdict": self.verdict,
            "control": claim.control["what"],
        }
        return record | (_numbers(self.evidence) if isinstance(self.evidence, Evidence) else {})


def _numbers(evidence: Evidence) -> dict[str, Any]:
    return {
        "quantity": evidence.quantity,
        "expected": f"{'>=' if evidence.at_least else '<='} {evidence.required:.4g}",
        "observed": float(f"{evidence.observed:.4g}"),
        "margin": float(f"{evidence.margin:.2g}"),
    }


@cache
def ledger() -> tuple[Claim, ...]:
    """All claims, section by section. Raises InputError for an entry that is none."""
    return tuple(declared(entry) for entry in entries())


def declared(entry: Mapping[str, Any]) -> Claim:
    """The claim of an entry. Raises InputError for fields too few or too many, and for an unknown check."""
    parameters = entry.get("parameters", {})
    scenes = parameters.get("scenes", [""])
    reads = [name.format(scene=scene) for name in entry["reads"] for scene in scenes]
    fields = {**entry, "parameters": parameters, "reads": tuple(dict.fromkeys(reads))}
    try:
        claim = Claim(**fields)
    except TypeError as error:
        raise InputError(f"ledger, claim '{entry['id']}': {error}") from None
    module, _, function = claim.check.partition(".")
    if not hasattr(CHECKS.get(module), function):
        raise InputError(f"ledger, claim '{claim.id}': there is no check '{claim.check}'")
    return claim


def judge(results: Tables, claims: Iterable[Claim] | None = None) -> list[Judgement]:
    """The claims' judgements by those tables."""
    return [_judgement(results, claim) for claim in claims or ledger()]


def _judgement(results: Tables, claim: Claim) -> Judgement:
    try:
        return Judgement(claim, claim.measure(results))
    except Unjudged as reason:
        return Judgement(claim, reason)


def find(wanted: str) -> Claim:
    """The claim with that id. Raises InputError, with the ids there are."""
    for claim in ledger():
        if claim.id == wanted:
            return claim
    known = ", ".join(claim.id for claim in ledger())
    raise InputError(f"there is no claim '{wanted}'; the ledger has {known}")


def plain(text: str) -> str:
    """A statement for the terminal: TeX's commands as letters, and its groups in parentheses."""
    for command, letter in LETTERS.items():
        text = text.replace(command, letter)
    return re.sub(r"\{(.)\}", r"\1", text).replace("{", "(").replace("}", ")")


def summary(judgements: Iterable[Judgement]) -> str:
    """A line per claim: id, observed against required, margin, verdict."""
    lines = [f"{'claim':9} {'observed':>10}    {'required':>10} {'margin':>8}  verdict"]
    for each in judgements:
        numbers, evidence = f"{'none':>10}    {'none':>10} {'none':>8}", each.evidence
        if isinstance(evidence, Evidence):
            sign = ">=" if evidence.at_least else "<="
            numbers = f"{evidence.observed:10.4g} {sign} {evidence.required:10.4g} {_percent(evidence):>8}"
        lines.append(f"{each.claim.id:9} {numbers}  {each.verdict}")
    return "\n".join(lines)


def _percent(evidence: Evidence) -> str:
    """The margin; nothing is relative to a requirement of 0."""
    known = math.isfinite(evidence.margin) and evidence.required != 0
    return f"{100 * evidence.margin:.3g} %" if known else "none"


def explanation(judgement: Judgement) -> str:
    """Everything about one claim, with its numbers."""
    claim, evidence = judgement.claim, judgement.evidence
    numbers, rows = [f"check: {claim.check} ({claim.source})"], []
    if isinstance(evidence, Evidence):
        sign = "at least" if evidence.at_least else "at most"
        numbers = [
            f"check: {evidence.quantity} has to be {sign} {evidence.required:.4g} ({claim.source})",
            f"observed: {evidence.observed:.4g}, margin {_percent(evidence)}",
        ]
        rows = evidence.lines
    lines = [
        f"{claim.id}: {plain(claim.statement)}",
        f"where: {claim.where}",
        *numbers,
        f"verdict: {judgement.verdict}",
        f"control: {claim.control['what']}",
        f"tables: {', '.join(claim.reads)}",
        *rows,
    ]
    return "\n".join(lines)
