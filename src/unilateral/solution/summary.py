"""What a solution shows of itself where Python or a notebook prints it: a few lines, and a picture.

Nothing is begun that takes long. On meshes of more than QUICK nodes a bound is shown only if it is known
already, and there is no picture.
"""

from __future__ import annotations

import base64
import math
from html import escape
from importlib.util import find_spec
from typing import TYPE_CHECKING

from unilateral.errors import counted
from unilateral.formulas.decimals import guaranteed, interval, percent
from unilateral.formulas.expression import ZERO
from unilateral.problems.fields import LINEAR_BETWEEN_NODES, linear_fields
from unilateral.solution.bounds import are_computed, sizes, too_large, wants_sharp

if TYPE_CHECKING:
    from unilateral.solution.bounds import Bounds
    from unilateral.solution.solution import Solution

LINEAR = "no side carries contact, so the problem is linear and has no multipliers"
QUICK = 100_000
"""Up to this many nodes a cheap bound takes less than a second, and a picture about two."""


def text(of: Solution) -> str:
    """The title, and a line for each of the `rows`."""
    return "\n".join([_title(of), *(f"  {name:16} {value}" for name, value in rows(of).items())])


def html(of: Solution) -> str:
    """The title, the `rows` as a table, and the picture if matplotlib is there."""
    lines = "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows(of).items())
    picture = "<p>The picture is drawn by plot().</p>"
    if of.mesh.n_nodes <= QUICK and find_spec("matplotlib"):
        picture = _picture(of)
    return f"<div><p><strong>{escape(_title(of))}</strong></p><table>{lines}</table>{picture}</div>"


def rows(of: Solution) -> dict[str, str]:
    """What is known of the solution, by names."""
    sharp = wants_sharp(of)
    cells = of.solved.cells
    solved = of.solved
    found = {"polygon": f"{of.polygon.n_sides} sides"}
    if linear := linear_fields(of.problem):
        found[", ".join(linear)] = LINEAR_BETWEEN_NODES
    found["unknowns"] = f"{of.mesh.n_nodes}, and {counted(len(cells), 'multiplier')}"
    if solved.foreign:
        found["u"] = "of another program"
    if not are_computed(of, sharp) and (of.mesh.n_nodes > QUICK or too_large(of, sharp)):
        found["error of u"] = "not bounded yet: see bounds"
    else:
        found |= _bounded(of, of.sharp_bounds if sharp else of.bounds, sharp)
    held = of.contact
    around = f"of {of.polygon.perimeter:.4g}"
    found["contact"] = "the whole boundary, " * held.full + f"length {held.length:.4g} {around}"
    if not len(cells):
        found["contact"] = LINEAR
    if not of.converged:
        found["not converged"] = (
            f"the algebraic error is {interval(-math.inf, solved.result.bound, spec='.2g')}"
        )
    if not of.unique:
        found["lambda_H"] = "may not be unique"
    return found


def _bounded(of: Solution, bounds: Bounds | None, sharp: bool) -> dict[str, str]:
    """The rows of guaranteed errors and of the force, and of its sum with all reactions, known if c = 0."""
    if bounds is None:
        return {
            "error of u": "unknown, for there is no bound",
            "force": f"{of.solved.force:.4g}",
        }
    names = sizes(of.problem)
    parts = {"error of u": (bounds.u, bounds.relative_u, names.h1)}
    if len(of.solved.cells):
        parts["error of lambda"] = bounds.multiplier, bounds.relative_multiplier, names.hm12
    rows = {}
    for name, (bound, part, norm) in parts.items():
        share = f", {percent(part)} of {norm}" if part < 1 else ""
        rows[name] = guaranteed(f"{interval(-math.inf, bound, spec='.3g')}{share}", -math.inf, bound)
    if len(parts) == 1:
        return rows
    forces = {"force": of.force(sharp)}
    if of.problem.c == ZERO:
        forces["with reactions"] = of.force(sharp, range(of.polygon.n_sides))
    for name, (value, lower, upper) in forces.items():
        rows[name] = guaranteed(interval(lower, upper, value), lower, upper)
    return rows


def _title(of: Solution) -> str:
    title = of.problem.title
    return f"Solution of '{of.problem.name}'" + (f": {title}" if title else "")


def _picture(of: Solution) -> str:
    from unilateral.solution.plot import svg

    drawn = base64.b64encode(svg(of.plot()).encode()).decode("ascii")
    shows = f"u_h, the contact set, lambda_H and the gap of '{of.problem.name}'"
    return f'<img alt="{escape(shows)}" style="max-width: 100%" src="data:image/svg+xml;base64,{drawn}">'
