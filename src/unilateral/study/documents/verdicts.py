"""The ledger's verdicts for readers: tables, and which claims hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from unilateral.study.ledger import texts
from unilateral.study.ledger.records import holds


def holding(records: Sequence[Mapping[str, Any]]) -> dict[str, bool]:
    """Whether each claim holds, by its id; `records` are those of `results/claims.json`."""
    return {each["id"]: holds(each["verdict"]) for each in records}


def claims_tables(records: Sequence[Mapping[str, Any]]) -> dict[str, pd.DataFrame]:
    """A table per section of the ledger, by the block's name."""
    rows: dict[str, list[dict[str, str]]] = {}
    for each in records:
        row = {
            "claim": each["id"],
            "statement": f"{each['statement']} [{_cell(each['where'])}]",
            **_numbers(each),
            "sees": _sees(each["sees"]),
            "verdict": _cell(each["verdict"]),
        }
        rows.setdefault(f"claims-{each['section']}", []).append(row)
    return {name: pd.DataFrame(of) for name, of in rows.items()}


def _numbers(record: Mapping[str, Any]) -> dict[str, str]:
    """What is shown of the evidence; dashes for a claim that is not judged, or has nothing to measure."""
    quantity = record["quantity"]
    return {
        "what counts": texts.NONE if quantity is None else _cell(quantity),
        "observed": texts.observed(record),
        "margin": texts.margin(record),
    }


def _sees(part: str | None) -> str:
    """The text of `sees`, shortened for a narrow column: a factor, or a part of the control."""
    return part.replace("below", "<").removesuffix(" of the control") if part else texts.NONE


def _cell(text: str) -> str:
    """The text with letters and signs, for a table in Markdown."""
    return texts.letters(text).replace("|", r"\|")
