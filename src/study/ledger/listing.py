"""Claims on the terminal: a table of all that is as wide as the terminal, and everything about one."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from study.evidence import Evidence
from study.ledger import records
from study.ledger.texts import describe_margin, describe_observation, replace_greek, strip_tex
from unilateral.errors import InputError

if TYPE_CHECKING:
    from study.ledger.claims import Judgement

CLAIMS_RECORDS = "claims.json"
COLUMNS = {"claim": 9, "title": 34, "observed": 17, "margin": 8}
"""The columns before the verdict, and how many letters each takes."""
COLUMN_GAP = "  "
MIN_VERDICT_LETTERS = 23
"""What separates columns; the least width of the verdicts, for which `describe_observation` is left out."""
MARGIN_NOTE = (
    "The margin is how far the observed number is on the right side of the required one, relative to that. "
    "To see all about a claim, name it, as in: unilateral claims 4.12"
)


def read_claim_records(folder: str | Path) -> list[dict[str, Any]]:
    """The records of all claims in a folder of results.

    Raises InputError where there are none, and StorageError for a file that is damaged, or that the manifest
    lists with another SHA-256.
    """
    path = Path(folder, CLAIMS_RECORDS)
    if not path.is_file():
        raise InputError(
            f"there are no judged claims in '{folder}'; type 'make' in a clone of the project, or name the "
            "folder of its results by --results"
        )
    claim_records: list[dict[str, Any]] = records.read_records(path)
    records.check_listed_digest(folder, CLAIMS_RECORDS, records.read_listed_digests(folder))
    return claim_records


def list_claims(judged: Sequence[Mapping[str, Any]], width: int | None = None) -> Iterator[str]:
    """The lines of a table of records, section by section, and of a summary.

    On `width` letters verdicts are wrapped; without one every claim has one line.
    """
    columns = dict(COLUMNS)
    if width and width < _columns_width(columns) + MIN_VERDICT_LETTERS:
        del columns["observed"]
    verdict_width = max(width - _columns_width(columns), MIN_VERDICT_LETTERS) if width else None
    yield _align_columns({name: name for name in columns}, columns) + "verdict"
    for section, section_records in groupby(judged, lambda record: record["section"]):
        yield f"{section}:"
        for record in section_records:
            yield from _record_lines(record, columns, verdict_width)
    for text in (summarise_claims(judged), MARGIN_NOTE):
        yield from _wrap(text, width)


def _columns_width(columns: Mapping[str, int]) -> int:
    return sum(columns.values()) + len(COLUMN_GAP) * len(columns)


def _align_columns(values: Mapping[str, str], columns: Mapping[str, int]) -> str:
    return "".join(f"{values[name]:{width}}{COLUMN_GAP}" for name, width in columns.items())


def _record_lines(
    record: Mapping[str, Any], columns: Mapping[str, int], verdict_letters: int | None
) -> Iterator[str]:
    values = {
        "claim": record["id"],
        "title": strip_tex(record["title"]),
        "observed": describe_observation(record),
        "margin": describe_margin(record),
    }
    verdict = strip_tex(record["verdict"])
    for fault in (records.FAILS, records.UNJUDGED):
        if verdict.startswith(fault):
            verdict = fault.upper() + verdict.removeprefix(fault)
    first, *further_lines = _wrap(verdict, verdict_letters)
    yield _align_columns(values, columns) + first
    yield from (" " * _columns_width(columns) + line for line in further_lines)


def _wrap(text: str, width: int | None) -> list[str]:
    return textwrap.wrap(text, width, break_on_hyphens=False) if width else [text]


def summarise_claims(judged: Sequence[Mapping[str, Any]]) -> str:
    """How many claims hold, and which do not."""
    verdicts = [record["verdict"] for record in judged]
    failing = [record["id"] for record in judged if records.verdict_counts_against(record["verdict"])]
    unmeasured = sum(verdict.startswith(records.UNMEASURED) for verdict in verdicts)
    phrases = [
        f"{sum(map(records.verdict_holds, verdicts))} hold",
        *([f"{len(failing)} do NOT hold: {', '.join(failing)}"] if failing else []),
        *([f"in {unmeasured} there is nothing to measure"] if unmeasured else []),
    ]
    return f"{len(judged)} claims: {'; '.join(phrases)}."


def explain_claim(judgement: Judgement) -> str:
    """Everything about one claim, with its numbers."""
    claim = judgement.claim
    evidence = judgement.evidence
    record = judgement.record()
    lines = [f"{claim.id}: {strip_tex(claim.title)}", f"statement: {strip_tex(claim.statement)}"]
    lines.append(f"where: {strip_tex(claim.where)}")
    if evidence is None:
        return "\n".join([*lines, strip_tex(judgement.verdict)])
    numbers = [f"check: {claim.check} ({replace_greek(claim.source)})"]
    rows = []
    if isinstance(evidence, Evidence):
        sign = "at least" if evidence.is_minimum else "at most"
        quantity = strip_tex(evidence.quantity)
        numbers = [
            f"check: {quantity} has to be {sign} {evidence.required:.4g} ({replace_greek(claim.source)})",
            f"observed: {evidence.observed:.4g}, margin {describe_margin(record)}",
        ]
        rows = ["values:", *map(replace_greek, evidence.lines)]
    sees = f"; {judgement.sees} is enough to make the check fail" if judgement.sees else ""
    return "\n".join(
        [
            *lines,
            *numbers,
            f"verdict: {strip_tex(judgement.verdict)}",
            f"control: {replace_greek(claim.control['what'])}{sees}",
            f"tables: {', '.join(claim.reads)}",
            *rows,
        ]
    )
