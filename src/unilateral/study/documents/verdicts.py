"""The ledger's verdicts for readers: tables, and which claims hold."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from unilateral.study.ledger.records import PLENTY, holds, percent

ROUND_OFF = 1e-12
NONE = "–"
LETTERS = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "epsilon": "ε",
    "lambda": "λ",
    "mu": "μ",
    "nu": "ν",
    "rho": "ρ",
    "sigma": "σ",
    "omega": "ω",
    "tau": "τ",
    "pi": "π",
    "Pi": "Π",
}


def holding(records: Sequence[Mapping[str, Any]]) -> dict[str, bool]:
    """Whether each claim holds, by its id; `records` are those of `results/claims.json`."""
    return {each["id"]: holds(each["verdict"]) for each in records}


def claims_tables(records: Sequence[Mapping[str, Any]]) -> dict[str, pd.DataFrame]:
    """A table per section of the ledger, by the block's name."""
    rows: dict[str, list[dict[str, str]]] = {}
    for each in records:
        row = {
            "claim": each["id"],
            "statement": f"{each['statement']} [{_letters(each['where'])}]",
            **_numbers(each),
            "sees": _sees(each["sees"]),
            "verdict": _letters(each["verdict"]),
        }
        rows.setdefault(f"claims-{each['section']}", []).append(row)
    return {name: pd.DataFrame(of) for name, of in rows.items()}


def _numbers(record: Mapping[str, Any]) -> dict[str, str]:
    """What is shown of the evidence; dashes for a claim that is not judged, or has nothing to measure."""
    if record["observed"] is None:
        return dict.fromkeys(("what counts", "observed", "margin"), NONE)
    return {
        "what counts": _letters(record["quantity"]),
        "observed": f"{_observed(record)} {record['expected']}".replace(">=", "≥").replace("<=", "≤"),
        "margin": NONE if _requires_0(record) else percent(record["margin"]),
    }


def _sees(part: str | None) -> str:
    """The text of `sees`, shortened for a narrow column: a factor, or a part of the control."""
    return part.replace("below", "<").removesuffix(" of the control") if part else NONE


def _letters(text: str) -> str:
    """The text with the names of Greek letters as letters, and comparisons as signs."""
    for name, letter in LETTERS.items():
        text = re.sub(rf"(?<![a-zA-Z]){name}(?![a-zA-Z])", letter, text)
    return text.replace(">=", "≥").replace("<=", "≤").replace("->", "→").replace("|", r"\|")


def _observed(record: Mapping[str, Any]) -> str:
    """Three digits, but none of what is round-off, or eleven times what is required."""
    value = record["observed"]
    if abs(value) <= ROUND_OFF:
        return "0"
    return f"{value:.3g}" if abs(record["margin"]) < PLENTY else "much more"


def _requires_0(record: Mapping[str, Any]) -> bool:
    """Whether the requirement is 0, to which no margin can be relative."""
    return float(record["expected"].split()[1]) == 0
