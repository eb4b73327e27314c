"""Claims in words and numbers for readers: statements without TeX, what was observed, and margins."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from study.formats import DASH
from study.ledger.records import MAX_TOLD_MARGIN, format_margin

ZERO_OBSERVATION = 1e-12
TEX_LETTERS = {
    r"\frac12": "1/2 ", r"\partial ": "∂", r"\lambda": "λ", r"\mu": "μ", r"\beta": "β", r"\rho": "ρ",
    r"\sigma": "σ", r"\alpha": "α", r"\varepsilon": "ε", r"\Pi": "Π", r"\langle": "<", r"\rangle": ">",
    r"\|": "‖", r"\le ": "≤ ", r"\ge ": "≥ ", r"\sim": "~", r"\inf": "inf", r"\in ": "in ",
    r"\sup": "sup", r"\coth": "coth ", r"\max": "max", r"\min": "min", r"\log": "log", r"\gamma": "γ",
    r"\delta": "δ", r"\tau": "τ", r"\sum": "Σ", r"\Omega": "Ω", r"\Lambda": "Λ", r"\times": "×",
    r"\cdot": "·", r"\partial": "∂", r"\nu": "ν", r"\pi": "π", r"\omega": "ω", r"\sqrt": "√", r"\,": " ",
    r"\to": "→", r"\ln": "ln", r"\kappa": "κ", "$": "",
}  # fmt: skip
GREEK_LETTERS = {
    "alpha": "α", "beta": "β", "gamma": "γ", "epsilon": "ε", "lambda": "λ", "mu": "μ", "nu": "ν", "rho": "ρ",
    "sigma": "σ", "omega": "ω", "tau": "τ", "pi": "π", "Pi": "Π",
}  # fmt: skip


def strip_tex(text: str) -> str:
    """A text for the terminal: TeX's commands as letters, and its groups in parentheses."""
    for command, letter in TEX_LETTERS.items():
        text = text.replace(command, letter)
    return re.sub(r"\{(.)\}|(?<=_)\{([a-z]+)\}", r"\1\2", text).replace("{", "(").replace("}", ")")


def replace_greek(text: str) -> str:
    """A text without TeX, with the names of Greek letters as letters, and comparisons as signs."""
    for name, letter in GREEK_LETTERS.items():
        text = re.sub(rf"(?<![a-zA-Z]){name}(?![a-zA-Z])", letter, text)
    return text.replace(">=", "≥").replace("<=", "≤").replace("->", "→")


def describe_observation(record: Mapping[str, Any]) -> str:
    """Observed and required number of a record, such as 1.03 ≥ 0.9; a dash if nothing was observed.

    Three digits, but none of what is round-off, or eleven times what is required.
    """
    if record["observed"] is None:
        return DASH
    value = record["observed"]
    is_far = abs(record["margin"]) >= MAX_TOLD_MARGIN
    number = "much more" if is_far else f"{value:.3g}"
    return replace_greek(f"{'0' if abs(value) <= ZERO_OBSERVATION else number} {record['expected']}")


def describe_margin(record: Mapping[str, Any]) -> str:
    """The margin of a record; a dash if there is none, or 0 is required, to which nothing is relative."""
    is_finite = record["margin"] is not None and math.isfinite(record["margin"])
    return format_margin(record["margin"]) if is_finite and required_number(record) != 0 else DASH


def required_number(record: Mapping[str, Any]) -> float | None:
    """The number that is required, without its sign; None where nothing is."""
    return None if record["expected"] is None else float(record["expected"].split()[1])
