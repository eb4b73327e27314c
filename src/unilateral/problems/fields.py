"""A problem as Python and notebooks print it: its fields, as they were given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from unilateral.errors import shown
from unilateral.formulas.expression import ONE, Expression
from unilateral.problems.nodal import NodalTrace

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem

FUNCTION = "a function"
LINEAR_BETWEEN_NODES = "linear between the nodes of the mesh"
"""What is printed in place of a function, and of values at nodes."""


def fields_of(of: Problem) -> dict[str, str]:
    """The fields by their names; k, c, free sides and q only if they are given."""
    if of.exact:
        return {"polygon": repr(of.polygon), "free sides": listed(of.free_sides)}
    clamped = of.clamped_sides
    n = of.polygon.n_sides
    held = [side for side in range(n) if side not in of.free_sides and side not in clamped]
    found = {"polygon": f"{of.polygon.n_sides} sides, area {of.polygon.area:.4g}"}
    found["f"] = _written(of.f)
    found |= {"g": _on_sides(of.g, held)} if held else {}
    if clamped:
        found["clamped sides"] = listed(clamped)
        found["u there"] = _on_sides(of.g, clamped)
    found |= {name: str(each) for name, each in (("k", of.k), ("c", of.c)) if each != ONE}
    if of.free_sides:
        found["free sides"] = listed(of.free_sides)
        q = _on_sides(of.q, of.free_sides) if of.q else "0"
        found |= {"q": q} if q != "0" else {}
    return found


def headed(of: Problem) -> str:
    """The name and, if there is one, the title."""
    if of.exact:
        return f"Case '{of.name}' on '{of.polygon.name}': {of.title}"
    return f"Problem '{of.name}'" + (f": {of.title}" if of.title else "")


def as_text(of: Problem) -> str:
    """The fields in a line; of a case the heading, which says all that was given."""
    if of.exact:
        return headed(of)
    fields = ", ".join(f"{name} = {value}" for name, value in fields_of(of).items())
    return f"{headed(of)}; {fields}"


def as_html(head: str, fields: Mapping[str, str]) -> str:
    """A table for notebooks."""
    rows = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in fields.items())
    return f"<div><p><strong>{escape(head)}</strong></p><table>{rows}</table></div>"


def listed(sides: Sequence[int]) -> str:
    return ", ".join(map(str, sides)) or "none"


def _on_sides(given: Sequence[object], sides: Sequence[int]) -> str:
    """What is given on those sides: one for all if it is the same, else a list."""
    written = [_written(given[side]) for side in sides]
    return written[0] if len({*written}) == 1 else shown(f"[{', '.join(written)}]")


def _written(data: object) -> str:
    """A formula, which is cut if it is too long, or words for a function and for values at nodes."""
    if isinstance(data, Expression):
        return shown(data)
    return FUNCTION if callable(data) else LINEAR_BETWEEN_NODES


def linear_fields(problem: Problem) -> list[str]:
    """Which of f, g, q and u are linear between the nodes of the mesh, on one side at least."""
    linear = {"f"} if isinstance(problem.f, np.ndarray) else set()
    for side in range(problem.polygon.n_sides):
        field = "u" if side in problem.clamped_sides else "g"
        linear |= {field} if isinstance(problem.g[side], NodalTrace) else set()
    if any(isinstance(flux, NodalTrace) for flux in problem.q):
        linear.add("q")
    return sorted(linear)
