"""A problem as Python and notebooks print it: its fields, as they were given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from unilateral.errors import shown

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem
    from unilateral.problems.sampled import Sampled

FUNCTION = "a function"
"""What is printed in place of a function."""


def fields_of(of: Problem | Sampled) -> dict[str, str]:
    """The fields by their names; k, c, free sides and q only if they are given."""
    given, functions = of.declaration, callable(of.f)
    found = {"polygon": f"{of.polygon.n_sides} sides, area {of.polygon.area:.4g}"}
    found |= {name: FUNCTION if functions else _written(given.get(name)) for name in ("f", "g")}
    found |= {name: str(given[name]) for name in ("k", "c") if given.get(name, 1) != 1}
    if of.free_sides:
        found["free sides"] = listed(of.free_sides)
        q = [each for each in given.get("q", ()) if each not in (None, 0, "0")]
        found |= {"q": FUNCTION if functions else _written(given["q"])} if q else {}
    return found


def headed(of: Problem | Sampled) -> str:
    """The name and, if there is one, the title."""
    return f"Problem '{of.name}'" + (f": {of.title}" if of.title else "")


def as_text(of: Problem | Sampled) -> str:
    """The fields in a line."""
    fields = ", ".join(f"{name} = {value}" for name, value in fields_of(of).items())
    return f"{headed(of)}; {fields}"


def as_html(head: str, fields: Mapping[str, str]) -> str:
    """A table for notebooks."""
    rows = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in fields.items())
    return f"<div><p><strong>{escape(head)}</strong></p><table>{rows}</table></div>"


def listed(sides: Sequence[int]) -> str:
    return ", ".join(map(str, sides)) or "none"


def _written(given: Any) -> str:
    """A formula, or one per side; those that are too long are cut."""
    if isinstance(given, list):
        return shown("[" + ", ".join("none" if each is None else str(each) for each in given) + "]")
    return shown(given)
