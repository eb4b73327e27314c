"""What a solution shows of itself where Python or a notebook prints it: a few lines, and a picture.

Nothing is begun that takes long: on meshes of more than MAX_NODES_FOR_SUMMARY nodes a bound is shown only if
it is known already, and there is no picture.
"""

from __future__ import annotations

import base64
import math
from html import escape
from importlib.util import find_spec
from typing import TYPE_CHECKING

from unilateral.errors import pluralise
from unilateral.formulas.decimals import add_guarantee, format_interval, format_percent
from unilateral.formulas.expression import ZERO
from unilateral.problems.fields import NODAL_VALUES_TEXT, linear_fields
from unilateral.solution.bounds import (
    explain_memory_shortage,
    has_computed_bounds,
    name_solution_norms,
    uses_sharp_bounds,
)

if TYPE_CHECKING:
    from unilateral.solution.bounds import Bounds
    from unilateral.solution.solution import Solution

LINEAR_PROBLEM_NOTE = "no side carries contact, so the problem is linear and has no multipliers"
MAX_NODES_FOR_SUMMARY = 100_000
"""Up to this many nodes a cheap bound takes less than a second, and a picture about two."""


def render_summary_text(solution: Solution) -> str:
    """The title, and a line for each row of the summary."""
    lines = [f"  {name:16} {value}" for name, value in collect_summary_rows(solution).items()]
    return "\n".join([_summary_title(solution), *lines])


def render_summary_html(solution: Solution) -> str:
    """The title, the summary as a table, and the picture if matplotlib is there."""
    rows = collect_summary_rows(solution).items()
    table_rows = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
    picture = "<p>The picture is drawn by plot().</p>"
    if solution.mesh.n_nodes <= MAX_NODES_FOR_SUMMARY and find_spec("matplotlib"):
        picture = _embed_picture(solution)
    title = f"<p><strong>{escape(_summary_title(solution))}</strong></p>"
    return f"<div>{title}<table>{table_rows}</table>{picture}</div>"


def collect_summary_rows(solution: Solution) -> dict[str, str]:
    """Rows of the summary of a solution, texts by their names: forces, contact, errors, then sizes."""
    sharp = uses_sharp_bounds(solution)
    cells = solution.solved.cells
    solved = solution.solved
    bound_rows = {"error of u": "not bounded yet: see bounds"}
    rows = {}
    if has_computed_bounds(solution, sharp) or not (
        solution.mesh.n_nodes > MAX_NODES_FOR_SUMMARY or explain_memory_shortage(solution, sharp)
    ):
        bounds = solution.sharp_bounds if sharp else solution.bounds
        rows = _collect_force_rows(solution, bounds, sharp) if len(cells) else {}
        bound_rows = _collect_bound_rows(solution, bounds)
    contact = solution.contact
    lengths = f"{contact.length:.4g} of {solution.polygon.perimeter:.4g}"
    rows["contact"] = f"computed: {'the whole boundary, ' * contact.full}{lengths}"
    if not len(cells):
        rows["contact"] = LINEAR_PROBLEM_NOTE
    rows |= bound_rows
    if not solution.converged:
        rows["not converged"] = (
            f"the algebraic error is {format_interval(-math.inf, solved.result.bound, spec='.2g')}"
        )
    if not solution.unique:
        rows["lambda_H"] = "may not be unique"
    if solved.is_foreign:
        rows["u"] = "of another program"
    if linear := linear_fields(solution.problem):
        rows[", ".join(linear)] = NODAL_VALUES_TEXT
    rows["unknowns"] = f"{solution.mesh.n_nodes}, and {pluralise(len(cells), 'multiplier')}"
    return rows | {"polygon": f"{solution.polygon.n_sides} sides"}


def _collect_bound_rows(solution: Solution, bounds: Bounds | None) -> dict[str, str]:
    """The rows of guaranteed errors."""
    if bounds is None:
        return {"error of u": "unknown, because there is no bound"}
    names = name_solution_norms(solution.problem)
    errors = {"error of u": (bounds.u, bounds.relative_u, names.h1)}
    if len(solution.solved.cells):
        errors["error of lambda"] = bounds.multiplier, bounds.relative_multiplier, names.hm12
    rows = {}
    for name, (bound, relative, norm) in errors.items():
        share = f", {format_percent(relative)} of {norm}" if relative < 1 else ""
        text = f"{format_interval(-math.inf, bound, spec='.3g')}{share}"
        rows[name] = add_guarantee(text, -math.inf, bound)
    return rows


def _collect_force_rows(solution: Solution, bounds: Bounds | None, sharp: bool) -> dict[str, str]:
    """The rows of the force and, if c = 0, of its sum with all reactions, which is then known."""
    if bounds is None:
        return {"force": f"{solution.solved.force:.4g}"}
    forces = {"force": solution.force(sharp)}
    if solution.problem.c == ZERO:
        forces["with reactions"] = solution.force(sharp, range(solution.polygon.n_sides))
    rows = {}
    for name, (value, lower, upper) in forces.items():
        rows[name] = add_guarantee(format_interval(lower, upper, value), lower, upper)
    return rows


def _summary_title(solution: Solution) -> str:
    title = solution.problem.title
    return f"Solution of '{solution.problem.name}'" + (f": {title}" if title else "")


def _embed_picture(solution: Solution) -> str:
    from unilateral.solution.plot import render_svg

    picture = base64.b64encode(render_svg(solution.plot()).encode()).decode("ascii")
    alt_text = f"u_h, the contact set, lambda_H and the gap of '{solution.problem.name}'"
    return f'<img alt="{escape(alt_text)}" style="max-width: 100%" src="data:image/svg+xml;base64,{picture}">'
