"""The ledger judged and stored, and everything about one claim for the terminal."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from study.evidence import Evidence
from study.ledger.claims import Judgement, judge
from study.ledger.listing import table
from study.ledger.results import Results
from study.ledger.texts import letters, margin, plain
from unilateral.system.files import replacing


def judge_claims(tables: Sequence[str], claims: str) -> None:
    """Write and print the judgements of all claims, by the tables that lie in folders beside their file."""
    records = [each.record() for each in judge(Results(Path(claims).parent))]
    with replacing(claims) as temporary:
        temporary.write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")
    print(*table(records), sep="\n")


def explanation(judgement: Judgement) -> str:
    """Everything about one claim, with its numbers."""
    claim, evidence, record = judgement.claim, judgement.evidence, judgement.record()
    lines = [f"{claim.id}: {plain(claim.title)}", f"statement: {plain(claim.statement)}"]
    lines.append(f"where: {plain(claim.where)}")
    if evidence is None:
        return "\n".join([*lines, plain(judgement.verdict)])
    numbers, rows = [f"check: {claim.check} ({letters(claim.source)})"], []
    if isinstance(evidence, Evidence):
        sign = "at least" if evidence.at_least else "at most"
        quantity = plain(evidence.quantity)
        numbers = [
            f"check: {quantity} has to be {sign} {evidence.required:.4g} ({letters(claim.source)})",
            f"observed: {evidence.observed:.4g}, margin {margin(record)}",
        ]
        rows = ["values:", *map(letters, evidence.lines)]
    sees = f"; {judgement.sees} is enough to make the check fail" if judgement.sees else ""
    return "\n".join(
        [
            *lines,
            *numbers,
            f"verdict: {plain(judgement.verdict)}",
            f"control: {letters(claim.control['what'])}{sees}",
            f"tables: {', '.join(claim.reads)}",
            *rows,
        ]
    )
