"""The ledger judged and stored; and for the terminal, a line per claim, or everything about one."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from unilateral.study.ledger.claims import Judgement, judge
from unilateral.study.ledger.evidence import Evidence
from unilateral.study.ledger.records import percent
from unilateral.study.ledger.results import Results
from unilateral.system.files import replacing

LETTERS = {
    r"\frac12": "1/2 ", r"\partial ": "∂", r"\lambda": "λ", r"\mu": "μ", r"\beta": "β", r"\rho": "ρ",
    r"\sigma": "σ", r"\alpha": "α", r"\varepsilon": "ε", r"\Pi": "Π", r"\langle": "<", r"\rangle": ">",
    r"\|": "‖", r"\le ": "<= ", r"\ge ": ">= ", r"\sim": "~", r"\inf": "inf", r"\in ": "in ",
    r"\sup": "sup", r"\coth": "coth ", r"\max": "max", r"\min": "min", r"\log": "log", r"\gamma": "γ",
    r"\delta": "δ", r"\tau": "τ", r"\sum": "Σ", r"\Omega": "Ω", r"\Lambda": "Λ", r"\times": "×",
    r"\cdot": "·", r"\partial": "∂", r"\nu": "ν", r"\pi": "π", r"\omega": "ω", r"\sqrt": "√", r"\,": " ",
    "$": "",
}  # fmt: skip


def judge_claims(tables: Sequence[str], claims: str) -> None:
    """Write and print the judgements of all claims, by the tables that lie in folders beside their file."""
    found = judge(Results(Path(claims).parent))
    with replacing(claims) as temporary:
        temporary.write_text(json.dumps([each.record() for each in found], indent=1) + "\n", encoding="utf-8")
    print(summary(found))


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
    """The margin; "none" if it is not finite, or the requirement is 0, to which nothing is relative."""
    known = math.isfinite(evidence.margin) and evidence.required != 0
    return percent(evidence.margin) if known else "none"


def explanation(judgement: Judgement) -> str:
    """Everything about one claim, with its numbers."""
    claim, evidence = judgement.claim, judgement.evidence
    lines = [f"{claim.id}: {plain(claim.statement)}", f"where: {claim.where}"]
    if evidence is None:
        return "\n".join([*lines, judgement.verdict])
    numbers, rows = [f"check: {claim.check} ({claim.source})"], []
    if isinstance(evidence, Evidence):
        sign = "at least" if evidence.at_least else "at most"
        numbers = [
            f"check: {evidence.quantity} has to be {sign} {evidence.required:.4g} ({claim.source})",
            f"observed: {evidence.observed:.4g}, margin {_percent(evidence)}",
        ]
        rows = evidence.lines
    return "\n".join(
        [
            *lines,
            *numbers,
            f"verdict: {judgement.verdict}",
            f"control: {claim.control['what']}",
            *([f"sees: {judgement.sees}"] if judgement.sees else []),
            f"tables: {', '.join(claim.reads)}",
            *rows,
        ]
    )
