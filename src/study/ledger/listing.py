"""Claims on the terminal: a table of all that is as wide as the terminal, and everything about one."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from study.evidence import Evidence
from study.ledger import records
from study.ledger.texts import letters, margin, observed, plain
from unilateral.errors import InputError

if TYPE_CHECKING:
    from study.ledger.claims import Judgement

CLAIMS = "claims.json"
COLUMNS = {"claim": 9, "title": 34, "observed": 17, "margin": 8}
"""The columns before the verdict, and how many letters each takes."""
GAP = "  "
VERDICT = 23
"""What separates columns; the least width of the verdicts, for which `observed` is left out."""
NOTE = (
    "The margin is how far the observed number is on the right side of the required one, relative to that. "
    "To see all about a claim, name it, as in: unilateral claims 4.12"
)


def stored(folder: str | Path) -> list[dict[str, Any]]:
    """The records of all claims in a folder of results.

    Raises InputError where there are none, and StorageError for a file that is damaged, or that the manifest
    lists with another SHA-256.
    """
    path = Path(folder, CLAIMS)
    if not path.is_file():
        raise InputError(
            f"there are no judged claims in '{folder}'; type 'make' in a clone of the project, or name the "
            "folder of its results by --results"
        )
    found: list[dict[str, Any]] = records.read(path)
    records.check_listed(folder, CLAIMS, records.listed(folder))
    return found


def table(judged: Sequence[Mapping[str, Any]], width: int | None = None) -> Iterator[str]:
    """The lines of a table of records, section by section, and of a summary.

    On `width` letters verdicts are wrapped; without one every claim has one line.
    """
    columns = dict(COLUMNS)
    if width and width < _width(columns) + VERDICT:
        del columns["observed"]
    room = max(width - _width(columns), VERDICT) if width else None
    yield _row({name: name for name in columns}, columns) + "verdict"
    for section, of in groupby(judged, lambda each: each["section"]):
        yield f"{section}:"
        for each in of:
            yield from _lines(each, columns, room)
    for text in (summary(judged), NOTE):
        yield from _wrapped(text, width)


def _width(columns: Mapping[str, int]) -> int:
    return sum(columns.values()) + len(GAP) * len(columns)


def _row(values: Mapping[str, str], columns: Mapping[str, int]) -> str:
    return "".join(f"{values[name]:{width}}{GAP}" for name, width in columns.items())


def _lines(record: Mapping[str, Any], columns: Mapping[str, int], room: int | None) -> Iterator[str]:
    values = {
        "claim": record["id"],
        "title": plain(record["title"]),
        "observed": observed(record),
        "margin": margin(record),
    }
    verdict = plain(record["verdict"])
    for fault in (records.FAILS, records.UNJUDGED):
        if verdict.startswith(fault):
            verdict = fault.upper() + verdict.removeprefix(fault)
    first, *more = _wrapped(verdict, room)
    yield _row(values, columns) + first
    yield from (" " * _width(columns) + each for each in more)


def _wrapped(text: str, width: int | None) -> list[str]:
    return textwrap.wrap(text, width, break_on_hyphens=False) if width else [text]


def summary(judged: Sequence[Mapping[str, Any]]) -> str:
    """How many claims hold, and which do not."""
    verdicts = [each["verdict"] for each in judged]
    failing = [each["id"] for each in judged if records.counts_against(each["verdict"])]
    unmeasured = sum(verdict.startswith(records.UNMEASURED) for verdict in verdicts)
    parts = [
        f"{sum(map(records.holds, verdicts))} hold",
        *([f"{len(failing)} do NOT hold: {', '.join(failing)}"] if failing else []),
        *([f"in {unmeasured} there is nothing to measure"] if unmeasured else []),
    ]
    return f"{len(judged)} claims: {'; '.join(parts)}."


def explanation(judgement: Judgement) -> str:
    """Everything about one claim, with its numbers."""
    claim = judgement.claim
    evidence = judgement.evidence
    record = judgement.record()
    lines = [f"{claim.id}: {plain(claim.title)}", f"statement: {plain(claim.statement)}"]
    lines.append(f"where: {plain(claim.where)}")
    if evidence is None:
        return "\n".join([*lines, plain(judgement.verdict)])
    numbers = [f"check: {claim.check} ({letters(claim.source)})"]
    rows = []
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
