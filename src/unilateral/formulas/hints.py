"""What is meant, perhaps, by what is no formula."""

from __future__ import annotations

import re
from collections.abc import Iterable

from unilateral.errors import shown

INSTEAD = {
    "abs": "pos(a, 1) + pos(-a, 1) for abs(a)",
    "max": "b + pos(a - b, 1) for max(a, b)",
    "min": "a - pos(a - b, 1) for min(a, b)",
    "ln": "log(a) for ln(a)",
}
"""Of functions that people try."""
FACTOR = re.compile(r"(?<![\w.])(\d+(?:\.\d*)?)\s*(?![eE][-+\d])([a-zA-Z]\w*|\()")
"""A number and what it multiplies without a sign, such as 2x."""


def hint(source: str, error: Exception) -> str:
    """How to mend what Python's parser refused, after a semicolon; nothing where that cannot be guessed."""
    if "leading zeros" in str(error):
        return "; write 10 for 010"
    found = FACTOR.search(source)
    return f"; write {found[1]}*{found[2]} for {shown(found[0])}" if found else ""


def not_called(name: str, factor: bool, known: Iterable[str]) -> str:
    """Why what stands before parentheses is no function; it may be the `factor` of a product."""
    if factor:
        return f"is not a product; write {shown(name)}*(...)"
    meant = f"write {INSTEAD[name]}" if name in INSTEAD else f"known are {', '.join(known)}"
    return f"is not a known function; {meant}"
