"""The ledger's verdicts for readers: tables, and which claims hold."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from study.formats import DASH
from study.ledger import texts
from study.ledger.records import source_origin, verdict_holds

DAGGER = " †"
"""The mark of a required number that was set after values had been seen."""
FORMULA = re.compile(r"\$[^$]+\$")
SCIENTIFIC_NUMBER = re.compile(r"(-?)([0-9.]+)e([+-][0-9]+)")
TEX_SIGNS = {"≥": r"\ge", "≤": r"\le", "much more": r"\text{much more}"}


def holds_by_claim(records: Sequence[Mapping[str, Any]]) -> dict[str, bool]:
    """Whether each claim holds, by its id; `records` are those of `results/claims.json`."""
    return {record["id"]: verdict_holds(record["verdict"]) for record in records}


def tabulate_claims(records: Sequence[Mapping[str, Any]]) -> dict[str, pd.DataFrame]:
    """A table per section of the ledger, by the block's name.

    Bars in formulas are commands of TeX, as a bar ends a cell.
    """
    rows: dict[str, list[dict[str, str]]] = {}
    for record in records:
        row = {
            "claim": record["id"],
            "statement": f"{record['statement']} [{record['where']}]",
            "measured": _describe_measurement(record),
            "verdict": record["verdict"],
        }
        cells = {name: FORMULA.sub(_replace_bars, cell) for name, cell in row.items()}
        rows.setdefault(f"claims-{record['section']}", []).append(cells)
    return {name: pd.DataFrame(section_rows) for name, section_rows in rows.items()}


def _describe_measurement(record: Mapping[str, Any]) -> str:
    """Quantity, value and margin of a record, and the smallest share its check sees; or a dash.

    A required number that was set after values had been seen has a dagger.
    """
    if record["quantity"] is None:
        return DASH
    margin = texts.describe_margin(record)
    sees = record["sees"]
    comparison = _format_comparison(texts.describe_observation(record))
    late = DAGGER if source_origin(record["source"]) == "after" else ""
    phrases = [f"{record['quantity']}: {comparison}{late}"]
    phrases += [f"margin {margin}"] if margin != DASH else []
    phrases += [f"sees {sees.removesuffix(' of the control')}"] if sees else []
    return "; ".join(phrases).replace(" %", "\u00a0%").replace("× ", "×\u00a0")


def _replace_bars(formula: re.Match[str]) -> str:
    """A formula with the bars of norms and moduli as commands of TeX."""
    return formula[0].replace(r"\|", r"\Vert ").replace("|", r"\vert ")


def _format_comparison(text: str) -> str:
    """A comparison of numbers in TeX, with powers of ten."""
    text = SCIENTIFIC_NUMBER.sub(_format_tex_power, text)
    for sign, tex in TEX_SIGNS.items():
        text = text.replace(sign, tex)
    return f"${text}$"


def _format_tex_power(number: re.Match[str]) -> str:
    minus = number[1]
    mantissa = number[2]
    power = int(number[3])
    factor = "" if mantissa == "1" else rf"{mantissa}\cdot "
    return f"{minus}{factor}10^{{{power}}}"
