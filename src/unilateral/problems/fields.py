"""A problem as Python and notebooks print it: its fields, as they were given."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from unilateral.errors import shown
from unilateral.formulas.expression import ONE, Expression

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem
    from unilateral.problems.sampled import Function, Sampled

FUNCTION, ARRAY = "a function", "an array"
"""What is printed in place of these."""


def fields_of(of: Problem | Sampled) -> dict[str, str]:
    """The fields by their names; k, c, free sides and q only if they are given."""
    if of.exact:
        return {"polygon": repr(of.polygon), "free sides": listed(of.free_sides)}
    clamped, n = of.clamped_sides, of.polygon.n_sides
    held = [side for side in range(n) if side not in of.free_sides and side not in clamped]
    found = {"polygon": f"{of.polygon.n_sides} sides, area {of.polygon.area:.4g}"}
    found["f"] = ARRAY if of.nodal.f is not None else _written(of.f)
    found |= {"g": _on_sides(of.g, of.nodal.g, held)} if held else {}
    if clamped:
        found["clamped sides"], found["u there"] = listed(clamped), _on_sides(of.g, of.nodal.g, clamped)
    found |= {name: str(each) for name, each in (("k", of.units.k), ("c", of.units.c)) if each != ONE}
    if of.free_sides:
        found["free sides"] = listed(of.free_sides)
        q = _on_sides(of.q, of.nodal.q, of.free_sides) if of.q else "0"
        found |= {"q": q} if q != "0" else {}
    return found


def headed(of: Problem | Sampled) -> str:
    """The name and, if there is one, the title."""
    return f"Problem '{of.name}'" + (f": {of.title}" if of.title else "")


def as_text(of: Problem | Sampled) -> str:
    """The fields in a line."""
    if of.exact:
        return f"Case '{of.name}' on '{of.polygon.name}': {of.title}"
    fields = ", ".join(f"{name} = {value}" for name, value in fields_of(of).items())
    return f"{headed(of)}; {fields}"


def as_html(head: str, fields: Mapping[str, str]) -> str:
    """A table for notebooks."""
    rows = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in fields.items())
    return f"<div><p><strong>{escape(head)}</strong></p><table>{rows}</table></div>"


def listed(sides: Sequence[int]) -> str:
    return ", ".join(map(str, sides)) or "none"


def _on_sides(given: Sequence[Expression | Function], at_nodes: Collection[int], sides: Sequence[int]) -> str:
    """What is given on those sides: one for all if it is the same, else a list."""
    written = [ARRAY if side in at_nodes else _written(given[side]) for side in sides]
    return written[0] if len({*written}) == 1 else shown(f"[{', '.join(written)}]")


def _written(of: Expression | Function) -> str:
    """A formula, which is cut if it is too long, or a word for a function."""
    formula = of if isinstance(of, Expression) else getattr(of, "formula", None)
    return shown(formula) if isinstance(formula, Expression) else FUNCTION
