"""What `unilateral solve` prints."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from unilateral.adaptive.forecast import Plan
from unilateral.adaptive.level import NOT_ENCLOSED, Level
from unilateral.adaptive.loop import Search
from unilateral.adaptive.marking import refinement_pays
from unilateral.bounds.forces import Force
from unilateral.cli.guard import as_options
from unilateral.errors import counted
from unilateral.formulas.decimals import down, guaranteed, interval, up
from unilateral.problems.problem import Problem
from unilateral.solution.bounds import Bounds, Named, energy, relative, sizes
from unilateral.solution.summary import LINEAR
from unilateral.system.files import sized

DIGITS = ".4e"
"""The format of errors, bounds and forces."""
NARROW = 1e-4
"""A force whose interval is narrower than this part of it is printed with the digits that are known."""
SIDES = 12
INTERVALS = 4
"""Forces are computed, and the contact on sides is printed, for at most SIDES sides.

At most INTERVALS intervals of a side are printed.
"""
NORMS_WITH_COEFFICIENTS = "||v||_1^2 is k |v|_1^2 + c ||v||_0^2, and ||.||_-1/2 its dual norm"
WITHOUT_REACTION = "errors are in the norm {}, as c = 0, and ||.||_-1/2 is its dual norm"
COLUMNS = ("h", "least h", "H", "unknowns", "multipliers", "steps", "algebraic", "total", "wanted")


def head(found: dict[str, Any]) -> str:
    ratio = found["h"] / found["H"]
    return f"{found['problem']}: h = {found['h']:.6g}, H = {found['H']:.6g}, h/H = {ratio:.4g}"


def errors_of(problem: Problem) -> Named:
    """The names of the errors that are bounded."""
    return Named(energy(problem, "u - u_h"), "||lambda - lambda_H||_-1/2")


class ForceRow(NamedTuple):
    """A force by its `name` in JSON and by the `label` of its row for readers."""

    name: str
    label: str
    force: Force


def table(
    found: dict[str, Any],
    bounds: Bounds | None,
    least: dict[str, float],
    forces: Sequence[ForceRow],
    doubt: str,
    problem: Problem,
) -> str:
    """Rows for a reader: what was found with its bounds.

    `least` are lower bounds on the norms of the solution, by the names of norms. `doubt` is what is told of a
    lambda_H that may not be unique, else empty.
    """
    steps = "" if _unknown(found["iterations"]) else f", after {counted(found['iterations'], 'step')}"
    outcome = "converged" if found["converged"] else "NOT converged"
    unique = found["unique"]
    algebraic = guaranteed(
        f"algebraic error {interval(-math.inf, found['algebraic_bound'], spec=DIGITS)}",
        -math.inf,
        found["algebraic_bound"],
    )
    rows = {"unknowns": f"{found['unknowns']} and {counted(found['multipliers'], 'multiplier')}"}
    if not found["foreign"]:
        rows[f"{found['algorithm']} {outcome}"] = algebraic + steps
    if found["multipliers"] and not _unknown(found["hm12_algebraic_bound"]):
        bound = found["hm12_algebraic_bound"]
        of_lambda = f"{interval(-math.inf, bound, spec=DIGITS)} in H^(-1/2)"
        of_beta = f"as beta >= {down(found['beta'], '.3f')}"
        rows["that of lambda_H"] = f"{guaranteed(of_lambda, -math.inf, bound)}, {of_beta}"
    if not _unknown(found["h1_error"]):
        rows |= _errors(found, unique, errors_of(problem))
    if bounds is not None:
        label = "guaranteed" if bounds.u < math.inf else "error of u"
        rows[label] = _bounded("h1", bounds.u, least["h1"], problem)
        if found["multipliers"]:
            label = "also guaranteed" if bounds.multiplier < math.inf else "error of lambda"
            rows[label] = _bounded("hm12", bounds.multiplier, least["hm12"], problem)
        enclosed = f"at most {up(bounds.unknown, '.1e')} for approximating f, g and q"
        rows["these bounds include"] = f"all rounding errors, and {enclosed}"
    rows |= _contact(found["contact"]) if found["multipliers"] else {"contact": LINEAR}
    for row in forces:
        value, lower, upper = row.force
        spec = "" if 0 < upper - lower < NARROW * abs(value) else DIGITS
        rows[row.label] = interval(lower, upper, value, spec)
    if doubt:
        rows["lambda_H"] = doubt
    rows["time and memory"] = f"{found['seconds']:.2f} s, {found['peak_mb']:.0f} MB"
    return "\n".join(f"  {name:27} {value}" for name, value in rows.items())


def _bounded(norm: str, bound: float, size: float, problem: Problem) -> str:
    """A bound on the error in a norm, and, where that is known to be `size` or more, on the relative one."""
    error = getattr(errors_of(problem), norm)
    if not bound < math.inf:
        return f"{error} is unknown"
    text = f"{error} <= {up(bound, DIGITS)}"
    if size > 0:
        share = up(relative(bound, size), ".3g")
        named = getattr(sizes(problem), norm)
        text += f" <= {share} {named}, {named} >= {down(size, DIGITS)}"
    return text


def written(file: Path) -> str:
    """The row of a file that was written."""
    return f"  {'written':27} {file}, {sized(file)}"


def _contact(found: dict[str, Any]) -> dict[str, str]:
    """The rows of the contact set: one, and one for each side in contact unless there are too many."""
    if found["full"]:
        return {"contact": f"the whole boundary, length {found['length']:.6g}"}
    rows = {"contact": f"length {found['length']:.6g}" if found["intervals"] else "none"}
    sides = sorted({each["side"] for each in found["intervals"]})
    for side in sides if len(found["lengths"]) <= SIDES else ():
        of = [each for each in found["intervals"] if each["side"] == side]
        shown = ", ".join(f"{each['start']:.6g} to {each['end']:.6g}" for each in of[:INTERVALS])
        more = f" and {len(of) - INTERVALS} more" if len(of) > INTERVALS else ""
        rows[f"contact, side {side}"] = f"{shown}{more}; length {found['lengths'][side]:.6g}"
    return rows


def _errors(found: dict[str, Any], unique: bool, names: Named) -> dict[str, str]:
    """The rows of the true errors."""

    def number(key: str, written: Callable[[float, str], str] = format) -> str:
        return why if _unknown(found[key]) else written(found[key], DIGITS)

    why = (
        "undefined, because lambda is not in L2" if unique else "not judged, because beta is 0 up to rounding"
    )
    dual = f">= {number('hm12_error_lower', down)}" if unique else f" = {why}"
    if unique and _unknown(found["hm12_error_lower"]):
        dual = " is left out, because it takes longer than the solve or needs gmsh; in Python: s.errors"
    if not _unknown(found["hm12_error_upper"]):
        dual += f", <= {number('hm12_error_upper', up)}"
    of_lambda = {names.hm12: dual, "||lambda - lambda_H||_0": f" = {number('l2_error')}"}
    return {names.h1: f" = {number('h1_error')}"} | (of_lambda if found["multipliers"] else {})


def level_head(problem: Problem, first: Level) -> str:
    """What is wanted, the columns' names and the first level."""
    columns = "".join(f"{column:>12}" for column in COLUMNS)
    goal = first.goal
    error = getattr(errors_of(problem), goal.norm)
    size = getattr(sizes(problem), goal.norm)
    wanted = f"{problem.name}: {error} <= {goal.accuracy:g}" + f" {size}" * (not goal.absolute)
    return "\n".join([wanted, columns, level_line(first)])


def level_line(level: Level) -> str:
    """The row of a level."""
    solved = level.solved
    mesh = level.solved.mesh
    sizes = mesh.h, float(np.diff(mesh.s).min()), level.partition.H
    shown = [f"{size:.4g}" for size in sizes]
    shown += [f"{level.unknowns}", f"{len(solved.cells)}", f"{solved.result.iterations:.4g}"]
    wanted = down(level.target, ".4g") if level.target else f"{level.nothing:.4g}"
    shown += [up(level.algebraic, ".4g"), up(level.total, ".4g"), wanted]
    return "".join(f"{each:>12}" for each in shown)


def next_line(level: Level) -> str:
    """What the next level is expected to take, with the two digits that a prediction may have."""
    return f"  next: about {level.next_unknowns:.2g} unknowns, {level.next_seconds:.2g} s"


def ending(search: Search, problem: Problem) -> str:
    """Whether the accuracy is certified, and if not what ended the search, by default the budget."""
    best = search.best
    norm = search.best.goal.norm
    if not search.believed:
        return f"  NOT certified, {search.ended}: no bound is left"
    reached = _bounded(norm, best.total, best.size, problem)
    if best.certified:
        return f"  certified: {reached}"
    bound = best.solved.bound(best.goal.sharp)
    if bound and search.ended == NOT_ENCLOSED:
        return (
            f"  NOT guaranteed, because {NOT_ENCLOSED}: {reached}; {up(bound.unknown, DIGITS)} of this bound "
            f"is for approximating them, and the rest, {best.total - bound.unknown:{DIGITS}}, "
            "is only an estimate"
        )
    needed = f"; that needs {amounts(search.plan)}" if search.plan else ""
    return f"  NOT certified, {as_options(search.ended)}: {reached}{needed}{_reach(search)}"


def _reach(search: Search) -> str:
    return f"; try --accuracy {search.reach:g}" if search.reach else ""


def rounded(plan: Plan) -> Plan:
    """The plan, with the two digits that a prediction may have."""
    unknowns = float(f"{plan.unknowns:.2g}")
    seconds = float(f"{plan.seconds:.2g}")
    mb = float(f"{plan.peak_mb:.2g}")
    return replace(plan, unknowns=round(unknowns), seconds=seconds, peak_mb=mb)


def amounts(plan: Plan) -> str:
    of = rounded(plan)
    return f"about {of.unknowns:g} unknowns, {of.seconds:g} s and {of.peak_mb:g} MB"


def planned(name: str, search: Search, as_json: bool) -> str:
    """What a dry run found, as text or as JSON, with null for what is unknown."""
    plan = search.plan
    last = search.levels[-1]
    if as_json:
        found = asdict(rounded(plan)) if plan else {field.name: None for field in fields(Plan)}
        return json.dumps({"problem": name, **found, "ended": search.ended or None, "reach": search.reach})
    if plan is None:
        why = search.ended or "because too little is known yet about the size of the solution or of the error"
        return f"  plan: unknown, {as_options(why)}"
    fits = f"; not within {', '.join(plan.missed)}" if plan.missed else ", within the limits"
    if plan.adapted:
        why = "adapted meshes, because a few triangles contribute most of the bound"
    elif refinement_pays(last):
        why = "uniform meshes, because the norm, bound, mesh or algorithm that was asked for needs them"
    else:
        why = "uniform meshes, because all triangles contribute much the same to the bound"
    rule = "H = 2h, because lambda_H may be unstable where edges are longer than half of a cell"
    return f"  plan: {amounts(plan)}{as_options(fits)}{_reach(search)}\n  {why}\n  {rule}"


def _unknown(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)
