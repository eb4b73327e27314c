"""The ledger's verdicts for readers: tables, and which claims hold."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from study.ledger import texts
from study.ledger.records import holds

NUMBER = re.compile(r"(-?)([0-9.]+)e([+-][0-9]+)")
SIGNS = {"≥": r"\ge", "≤": r"\le", "much more": r"\text{much more}"}


def holding(records: Sequence[Mapping[str, Any]]) -> dict[str, bool]:
    """Whether each claim holds, by its id; `records` are those of `results/claims.json`."""
    return {each["id"]: holds(each["verdict"]) for each in records}


def claims_tables(records: Sequence[Mapping[str, Any]]) -> dict[str, pd.DataFrame]:
    """A table per section of the ledger, by the block's name."""
    rows: dict[str, list[dict[str, str]]] = {}
    for each in records:
        row = {
            "claim": each["id"],
            "statement": f"{each['statement']} [{each['where']}]",
            "measured": _measured(each),
            "verdict": each["verdict"],
        }
        rows.setdefault(f"claims-{each['section']}", []).append(row)
    return {name: pd.DataFrame(of) for name, of in rows.items()}


def _measured(record: Mapping[str, Any]) -> str:
    """What counts and its value, the margin, and what the check sees; a dash if nothing was measured."""
    if record["quantity"] is None:
        return texts.NONE
    margin = texts.margin(record)
    sees = record["sees"]
    parts = [f"{record['quantity']}: {_formula(texts.observed(record))}"]
    parts += [f"margin {margin}"] if margin != texts.NONE else []
    parts += [f"sees {sees.removesuffix(' of the control')}"] if sees else []
    return "; ".join(parts).replace(" %", "\u00a0%").replace("× ", "×\u00a0")


def _formula(text: str) -> str:
    """A comparison of numbers in TeX, with powers of ten."""
    text = NUMBER.sub(_power, text)
    for sign, tex in SIGNS.items():
        text = text.replace(sign, tex)
    return f"${text}$"


def _power(number: re.Match[str]) -> str:
    minus = number[1]
    mantissa = number[2]
    power = int(number[3])
    factor = "" if mantissa == "1" else rf"{mantissa}\cdot "
    return f"{minus}{factor}10^{{{power}}}"
