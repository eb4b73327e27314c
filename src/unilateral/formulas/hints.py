"""Hints for messages: what a text that is no formula may have been meant to be."""

from __future__ import annotations

import re
from collections.abc import Iterable

from unilateral.errors import shown

INSTEAD = {
    "abs": "pos(a, 1) + pos(-a, 1) for abs(a)",
    "max": "b + pos(a - b, 1) for max(a, b)",
    "min": "a - pos(a - b, 1) for min(a, b)",
    "ln": "the number itself, such as 0.6931 for ln(2); there is no logarithm of x or y",
    "tan": "sin(a)/cos(a) for tan(a)",
    "sign": "2*pos(a, 0) - 1 for sign(a)",
    "where": "b + (a - b)*pos(c, 0) for where(c > 0, a, b)",
} | dict.fromkeys(("heaviside", "Heaviside", "step"), "pos(a, 0), which is 1 where a > 0 and else 0")
"""What to write in place of functions that people try."""
OF_NUMBERS = ("log", "sqrt")
"""Functions that messages do not offer: formulas may have them of numbers, not of x, y or t."""
NO_ROOT = "write a fractional power as pos(a, k), such as pos(a, 1/2) for sqrt(a)"
STEP = (
    "; there are no conditions in formulas; pos(a, 0) is 1 where a > 0 and 0 elsewhere, "
    "such as pos(x - 1/2, 0) for x > 1/2"
)
CONDITION = re.compile(r"[<>]|\bif\b")
COMMA = re.compile(r"(?<![\w.])(\d+),(\d+)")
FACTOR = re.compile(r"(?<![\w.])(\d+(?:\.\d*)?)\s*(?![eE][-+\d])([a-zA-Z]\w*|\()")
"""A number and what it multiplies without a sign, such as 2x."""


def hint(source: str, error: Exception) -> str:
    """How to mend what Python's parser refused, after a semicolon; nothing where that cannot be guessed."""
    if "leading zeros" in str(error):
        return "; write 10 for 010"
    if CONDITION.search(source):
        return STEP
    if found := FACTOR.search(source):
        return f"; write {found[1]}*{found[2]} for {shown(found[0])}"
    return comma(source)


def comma(source: str) -> str:
    """What to write in place of a decimal comma, if there may be one."""
    found = COMMA.search(source)
    return f"; write {found[1]}.{found[2]} for {found[0]}" if found else ""


def offered(known: Iterable[str]) -> str:
    """The names of the known functions that a formula may have of its variables."""
    return ", ".join(name for name in known if name not in OF_NUMBERS)


def not_called(name: str, factor: bool, known: Iterable[str]) -> str:
    """Why what stands before parentheses is no function; it may be the `factor` of a product."""
    if factor:
        return f"is not a product; write {shown(name)}*(...)"
    meant = f"write {INSTEAD[name]}" if name in INSTEAD else f"known are {offered(known)}"
    return f"is not a known function; {meant}"
