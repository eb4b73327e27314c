"""A problem as Python and notebooks print it: its fields, as they were given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from unilateral.errors import quote_input
from unilateral.formulas.expression import ONE, Expression
from unilateral.problems.nodal import NodalTrace
from unilateral.problems.side_tables import SideTable

if TYPE_CHECKING:
    from unilateral.geometry.polygon import Polygon
    from unilateral.problems.problem import Problem

FUNCTION_TEXT = "a function"
NODAL_VALUES_TEXT = "linear between the nodes of the mesh"
"""What is printed in place of a function, and of values at nodes."""


def problem_fields(problem: Problem) -> dict[str, str]:
    """The fields by their names; k, c, free sides and q only if they are given."""
    if problem.exact:
        return {
            "polygon": repr(problem.polygon),
            "free sides": join_sides(problem.free_sides, problem.polygon),
        }
    clamped = problem.clamped_sides
    fields = {"polygon": f"{problem.polygon.n_sides} sides, area {problem.polygon.area:.4g}"}
    fields["f"] = describe_data(problem.f)
    if problem.contact_sides:
        fields["g"] = _side_data_text(problem.g, problem.contact_sides)
    if clamped:
        fields["clamped sides"] = join_sides(clamped, problem.polygon)
        fields["u there"] = _side_data_text(problem.g, clamped)
    for name, coefficient in (("k", problem.k), ("c", problem.c)):
        if coefficient != ONE:
            fields[name] = str(coefficient)
    if problem.free_sides:
        fields["free sides"] = join_sides(problem.free_sides, problem.polygon)
        q = _side_data_text(problem.q, problem.free_sides) if problem.q else "0"
        fields |= {"q": q} if q != "0" else {}
    return fields


def problem_heading(problem: Problem) -> str:
    """The name and, if there is one, the title."""
    if problem.exact:
        return f"Case '{problem.name}' on '{problem.polygon.name}': {problem.title}"
    return f"Problem '{problem.name}'" + (f": {problem.title}" if problem.title else "")


def as_text(problem: Problem) -> str:
    """The fields in a line; of a case the heading, which says all that was given."""
    if problem.exact:
        return problem_heading(problem)
    fields = ", ".join(f"{name} = {value}" for name, value in problem_fields(problem).items())
    return f"{problem_heading(problem)}; {fields}"


def as_html(head: str, fields: Mapping[str, str]) -> str:
    """A table for notebooks."""
    rows = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in fields.items())
    return f"<div><p><strong>{escape(head)}</strong></p><table>{rows}</table></div>"


def join_sides(sides: Sequence[int], polygon: Polygon | None = None) -> str:
    """The numbers of sides with commas, or "none"; with their names, if the polygon is given."""
    return ", ".join(polygon.label_side(side) if polygon else str(side) for side in sides) or "none"


def _side_data_text(data: Sequence[object], sides: Sequence[int]) -> str:
    """The data on some sides as text: one for all if they are the same, else a list."""
    written = [describe_data(data[side]) for side in sides]
    return written[0] if len({*written}) == 1 else quote_input(f"[{', '.join(written)}]")


def describe_data(data: object) -> str:
    """A formula, which is cut if it is too long, or words for a function, a table and values at nodes."""
    if isinstance(data, SideTable):
        return f"a table of {len(data.t)} rows"
    if isinstance(data, Expression):
        return quote_input(data)
    return FUNCTION_TEXT if callable(data) else NODAL_VALUES_TEXT


def linear_fields(problem: Problem) -> list[str]:
    """Which of f, g, q and u are linear between the nodes of the mesh, on one side at least."""
    linear = {"f"} if isinstance(problem.f, np.ndarray) else set()
    for side in range(problem.polygon.n_sides):
        field = "u" if side in problem.clamped_sides else "g"
        linear |= {field} if _is_nodal(problem.g[side]) else set()
    if any(map(_is_nodal, problem.q)):
        linear.add("q")
    return sorted(linear)


def _is_nodal(data: object) -> bool:
    return isinstance(data, NodalTrace) and not isinstance(data, SideTable)
