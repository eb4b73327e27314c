"""What `unilateral solve` prints."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields, replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from unilateral.adaptive.forecast import Plan
from unilateral.adaptive.level import NOT_ENCLOSED, Level
from unilateral.adaptive.loop import Search
from unilateral.adaptive.marking import refinement_pays
from unilateral.bounds.certain_contact import CertainArc
from unilateral.bounds.forces import Force
from unilateral.cli.guard import rewrite_as_options
from unilateral.errors import pluralise
from unilateral.formulas.decimals import add_guarantee, format_down, format_interval, format_up
from unilateral.geometry.polygon import Polygon
from unilateral.problems.problem import Problem
from unilateral.solution.bounds import (
    Bounds,
    NormNames,
    name_energy_norm,
    name_solution_norms,
    relative_bound,
)
from unilateral.solution.contact import describe_certain_arcs
from unilateral.solution.summary import LINEAR_PROBLEM_NOTE
from unilateral.system.files import format_file_size

NUMBER_FORMAT = ".4e"
"""The format of errors, bounds and forces."""
NARROW_FORCE_RATIO = 1e-4
"""A force whose interval is narrower than this part of it is printed with the digits that are known."""
MAX_FORCE_SIDES = 12
MAX_INTERVALS_PER_SIDE = 4
"""Forces and the contact of sides are computed and printed for at most so many sides, and intervals."""
NORMS_WITH_COEFFICIENTS = "||v||_1^2 is k |v|_1^2 + c ||v||_0^2, and ||.||_-1/2 its dual norm"
WITHOUT_REACTION = "errors are in the norm {}, as c = 0, and ||.||_-1/2 is its dual norm"
LEVEL_COLUMNS = ("h", "least h", "H", "unknowns", "multipliers", "steps", "algebraic", "total", "wanted")


def format_head(record: dict[str, Any]) -> str:
    """First line of a result: the problem, h, H and their ratio."""
    ratio = record["h"] / record["H"]
    return f"{record['problem']}: h = {record['h']:.6g}, H = {record['H']:.6g}, h/H = {ratio:.4g}"


def name_errors(problem: Problem) -> NormNames:
    """The names of the errors that are bounded."""
    return NormNames(name_energy_norm(problem, "u - u_h"), "||lambda - lambda_H||_-1/2", "error of the force")


class ForceRow(NamedTuple):
    """A force by its `name` in JSON and by the `label` of its row for readers."""

    name: str
    label: str
    force: Force


def format_result(
    record: dict[str, Any],
    bounds: Bounds | None,
    norms_below: dict[str, float],
    forces: Sequence[ForceRow],
    nonuniqueness: str,
    problem: Problem,
) -> str:
    """Rows for a reader: forces, contact, bounds and true errors, then unknowns, the algorithm and cost.

    `norms_below` are lower bounds on the norms of the solution, by the names of norms. `nonuniqueness` are
    words on a lambda_H that may not be unique, else empty.
    """
    rows = {}
    for row in forces:
        value, lower, upper = row.force
        # a narrow interval is printed with as many digits as are known
        spec = "" if 0 < upper - lower < NARROW_FORCE_RATIO * abs(value) else NUMBER_FORMAT
        rows[row.label] = format_interval(lower, upper, value, spec)
    rows |= (
        _contact_rows(record["contact"], problem.polygon)
        if record["multipliers"]
        else {"contact": LINEAR_PROBLEM_NOTE}
    )
    if bounds is not None:
        label = "guaranteed" if bounds.u < math.inf else "error of u"
        rows[label] = _format_error_bound("h1", bounds.u, norms_below["h1"], problem)
        if record["multipliers"]:
            label = "also guaranteed" if bounds.multiplier < math.inf else "error of lambda"
            rows[label] = _format_error_bound("hm12", bounds.multiplier, norms_below["hm12"], problem)
        enclosed = f"at most {format_up(bounds.unknown, '.1e')} for approximating f, g and q"
        rows["these bounds include"] = f"all rounding errors, and {enclosed}"
    if not _is_unknown(record["h1_error"]):
        rows |= _true_error_rows(record, record["unique"], name_errors(problem))
    rows["unknowns"] = f"{record['unknowns']} and {pluralise(record['multipliers'], 'multiplier')}"
    rows |= _algorithm_rows(record)
    if nonuniqueness:
        rows["lambda_H"] = nonuniqueness
    rows["time and memory"] = f"{record['seconds']:.2f} s, {record['peak_mb']:.0f} MB"
    return "\n".join(f"  {name:27} {value}" for name, value in rows.items())


def _algorithm_rows(record: dict[str, Any]) -> dict[str, str]:
    """The rows of the algorithm, with its algebraic error in the norm of u, and of that of lambda_H."""
    rows = {}
    if not record["foreign"]:
        bound = record["algebraic_bound"]
        error = f"algebraic error {format_interval(-math.inf, bound, spec=NUMBER_FORMAT)}"
        steps = record["iterations"]
        after = "" if _is_unknown(steps) else f", after {pluralise(steps, 'step')}"
        outcome = "converged" if record["converged"] else "NOT converged"
        rows[f"{record['algorithm']} {outcome}"] = add_guarantee(error, -math.inf, bound) + after
    if record["multipliers"] and not _is_unknown(record["hm12_algebraic_bound"]):
        # ||mu||_-1/2 <= ||mu||_-1/2,h / beta, by (3.4)
        bound = record["hm12_algebraic_bound"]
        error = f"{format_interval(-math.inf, bound, spec=NUMBER_FORMAT)} in H^(-1/2)"
        beta_text = f"as beta >= {format_down(record['beta'], '.3f')}"
        rows["that of lambda_H"] = f"{add_guarantee(error, -math.inf, bound)}, {beta_text}"
    return rows


def _format_error_bound(norm: str, bound: float, norm_below: float, problem: Problem) -> str:
    """A bound on the error in a norm as text, and the relative one where the norm is known to be positive."""
    error = getattr(name_errors(problem), norm)
    if not bound < math.inf:
        return f"{error} is unknown"
    text = f"{error} <= {format_up(bound, NUMBER_FORMAT)}"
    if norm_below > 0:
        share = format_up(relative_bound(bound, norm_below), ".3g")
        size = getattr(name_solution_norms(problem), norm)
        text += f" <= {share} {size}, {size} >= {format_down(norm_below, NUMBER_FORMAT)}"
    return text


def format_file_row(file: Path) -> str:
    """The row of a file that was written."""
    return f"  {'written':27} {file}, {format_file_size(file)}"


def _contact_rows(contact_record: dict[str, Any], polygon: Polygon) -> dict[str, str]:
    """The rows of the contact set: its computed length and, unless there are too many, one for each side.

    What is certain of a side comes first, then the computed intervals.
    """
    whole = "the whole boundary, " * contact_record["full"]
    length = f"{whole}length {contact_record['length']:.6g}, computed"
    rows = {"contact": length if contact_record["intervals"] else "none, computed"}
    if len(contact_record["lengths"]) > MAX_FORCE_SIDES:
        return rows
    certain = [CertainArc(**arc) for arc in contact_record["certain"]]
    texts = {
        side: describe_certain_arcs([*arcs]) for side, arcs in groupby(certain, key=lambda arc: arc.side)
    }
    for side, side_length in enumerate(contact_record["lengths"]):
        intervals = [interval for interval in contact_record["intervals"] if interval["side"] == side]
        listed = ", ".join(
            f"{interval['start']:.6g} to {interval['end']:.6g}"
            for interval in intervals[:MAX_INTERVALS_PER_SIDE]
        )
        omitted = (
            f" and {len(intervals) - MAX_INTERVALS_PER_SIDE} more"
            if len(intervals) > MAX_INTERVALS_PER_SIDE
            else ""
        )
        computed = [f"computed: {listed}{omitted}, length {side_length:.6g}"] if intervals else []
        parts = ([texts[side]] if side in texts else []) + computed
        if parts:
            rows[f"contact, side {polygon.label_side(side)}"] = "; ".join(parts)
    return rows


def _true_error_rows(record: dict[str, Any], unique: bool, names: NormNames) -> dict[str, str]:
    """The rows of the true errors."""

    def format_error(key: str, to_text: Callable[[float, str], str] = format) -> str:
        """An error as text, or why it is not known."""
        return why if _is_unknown(record[key]) else to_text(record[key], NUMBER_FORMAT)

    why = (
        "undefined, because lambda is not in L2" if unique else "not judged, because beta is 0 up to rounding"
    )
    dual = f">= {format_error('hm12_error_lower', format_down)}" if unique else f" = {why}"
    if unique and _is_unknown(record["hm12_error_lower"]):
        dual = " is left out, because it takes longer than the solve or needs gmsh; in Python: s.errors"
    if not _is_unknown(record["hm12_error_upper"]):
        dual += f", <= {format_error('hm12_error_upper', format_up)}"
    multiplier_rows = {names.hm12: dual, "||lambda - lambda_H||_0": f" = {format_error('l2_error')}"}
    return {names.h1: f" = {format_error('h1_error')}"} | (multiplier_rows if record["multipliers"] else {})


def format_first_level(problem: Problem, first: Level) -> str:
    """The accuracy asked for, the headings of the columns, and the row of the first level."""
    columns = "".join(f"{column:>12}" for column in LEVEL_COLUMNS)
    goal = first.goal
    error = getattr(name_errors(problem), goal.norm)
    size = getattr(name_solution_norms(problem), goal.norm)
    goal_text = f"{problem.name}: {error} <= {goal.accuracy:g}" + f" {size}" * (not goal.absolute)
    return "\n".join([goal_text, columns, format_level(first)])


def format_level(level: Level) -> str:
    """The row of a level."""
    solved = level.solved
    mesh = level.solved.mesh
    sizes = mesh.h, float(np.diff(mesh.s).min()), level.partition.H
    entries = [f"{size:.4g}" for size in sizes]
    entries += [f"{level.unknowns}", f"{len(solved.cells)}", f"{solved.result.iterations:.4g}"]
    target = format_down(level.target, ".4g") if level.target else f"{level.zero_solution_error:.4g}"
    entries += [format_up(level.algebraic, ".4g"), format_up(level.total, ".4g"), target]
    return "".join(f"{entry:>12}" for entry in entries)


def format_forecast(level: Level) -> str:
    """Line on the unknowns and seconds that the next level is expected to take."""
    return f"  next: about {level.next_unknowns:.2g} unknowns, {level.next_seconds:.2g} s"


def describe_ending(search: Search, problem: Problem) -> str:
    """Whether the accuracy is certified, and if not what ended the search, by default the budget."""
    best = search.best
    norm = search.best.goal.norm
    if not search.believed:
        return f"  NOT certified, {search.ended}: no bound is left"
    reached = _format_error_bound(norm, best.total, best.size, problem)
    if best.certified:
        return f"  certified: {reached}"
    bound = best.solved.bound(best.goal.sharp)
    if bound and search.ended == NOT_ENCLOSED:
        remainder = format_up(bound.data_remainder, NUMBER_FORMAT)
        return (
            f"  NOT guaranteed, because {NOT_ENCLOSED}: {reached}; {remainder} of this bound is for "
            f"approximating them, and the rest, {best.total - bound.data_remainder:{NUMBER_FORMAT}}, is only "
            "an estimate"
        )
    needed = f"; that needs {format_plan(search.plan)}" if search.plan else ""
    return (
        f"  NOT certified, {rewrite_as_options(search.ended)}: {reached}{needed}{_suggest_accuracy(search)}"
    )


def _suggest_accuracy(search: Search) -> str:
    return f"; try --accuracy {search.reach:g}" if search.reach else ""


def round_plan(plan: Plan) -> Plan:
    """The plan with numbers of two digits, as many as a prediction may have."""
    unknowns = float(f"{plan.unknowns:.2g}")
    seconds = float(f"{plan.seconds:.2g}")
    mb = float(f"{plan.peak_mb:.2g}")
    return replace(plan, unknowns=round(unknowns), seconds=seconds, peak_mb=mb)


def format_plan(plan: Plan) -> str:
    """Unknowns, seconds and memory of a plan as text."""
    rounded = round_plan(plan)
    return f"about {rounded.unknowns:g} unknowns, {rounded.seconds:g} s and {rounded.peak_mb:g} MB"


def describe_plan(name: str, search: Search, as_json: bool) -> str:
    """Text of a dry run's plan, or a JSON object with null for what is unknown."""
    plan = search.plan
    last = search.levels[-1]
    if as_json:
        plan_fields = asdict(round_plan(plan)) if plan else {field.name: None for field in fields(Plan)}
        return json.dumps(
            {"problem": name, **plan_fields, "ended": search.ended or None, "reach": search.reach}
        )
    if plan is None:
        why = search.ended or "because too little is known yet about the size of the solution or of the error"
        return f"  plan: unknown, {rewrite_as_options(why)}"
    fits = f"; not within {', '.join(plan.missed)}" if plan.missed else ", within the limits"
    if plan.adapted:
        why = "adapted meshes, because a few triangles contribute most of the bound"
    elif refinement_pays(last):
        why = "uniform meshes, because the norm, bound, mesh or algorithm that you chose needs them"
    else:
        why = "uniform meshes, because all triangles contribute much the same to the bound"
    rule = "H = 2h, because lambda_H may be unstable where edges are longer than half of a cell"
    return (
        f"  plan: {format_plan(plan)}{rewrite_as_options(fits)}{_suggest_accuracy(search)}\n  {why}\n  {rule}"
    )


def _is_unknown(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)
