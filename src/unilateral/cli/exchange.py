"""The commands `unilateral export` and `unilateral score`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from json import dumps
from pathlib import Path
from typing import Any

from unilateral import api
from unilateral.cli.guard import EXIT_REJECTED, print_message, print_result
from unilateral.cli.mesh_options import make_mesh_of_size, read_mesh_option
from unilateral.discrete.choice import check_mesh_memory
from unilateral.errors import InputError, pluralise
from unilateral.exchange import export as exports
from unilateral.exchange import score as scores
from unilateral.exchange.equation_residual import FORM_AND_NORM_NAMES
from unilateral.exchange.exported_folder import (
    ExportedLevel,
    ForeignSolution,
    read_exported_folder,
    read_foreign_solution,
)
from unilateral.exchange.score import Rate, ScoredSolution
from unilateral.formulas.expression import ZERO
from unilateral.geometry.partition import make_uniform_partition
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem
from unilateral.system.files import check_target, format_file_size, replacing

MAX_EXPORT_LEVELS = 12
PAGE_ENDINGS = {".html": ["matplotlib"], ".htm": ["matplotlib"]}
"""The endings of pages with plots, and what draws these."""


def run_export(
    case: str,
    h: float | None,
    H: float,
    levels: int,
    mesh: str | None,
    polygon: str | None,
    side: int,
    free_sides: tuple[int, ...] | None,
    out: str,
) -> None:
    """Write a case as files."""
    if problem_file.is_problem_file(case):
        raise InputError(f"{case} declares a problem; only a case has a known solution to compare with")
    if levels > MAX_EXPORT_LEVELS:
        raise InputError(f"argument --levels: {levels} is more than {MAX_EXPORT_LEVELS}")
    problem = api.case(case, polygon, side, free_sides or ())
    if mesh is not None:
        coarse = read_mesh_option(mesh, problem.polygon)
    elif h is not None:
        check_mesh_memory(problem.polygon, h)
        coarse = make_mesh_of_size(problem.polygon, h * 2 ** (levels - 1))
    exports.export_case(problem, coarse, H, levels, out)
    # the beta of (3.4) may be 0 then
    if coarse.h / 2 ** (levels - 1) >= make_uniform_partition(problem.polygon, H).H:
        print_message("the multiplier may not be unique, because h >= H; take h < H, such as H = 2h")
    print_result(f"{problem.name}: {pluralise(levels, 'level')} in {out}")
    for folder in (Path(out), *sorted(file for file in Path(out).iterdir() if file.is_dir())):
        files = sorted(file for file in folder.iterdir() if file.is_file())
        print_result(f"  {folder}: {', '.join(file.name for file in files)}; {format_file_size(*files)}")


def run_score(
    folder: str, solutions: Sequence[str], multipliers: Sequence[str], html: str | None, json: bool
) -> int:
    """Print the errors, rates and faults of another solver's solutions; the exit code."""
    if html is not None:
        check_target(html, PAGE_ENDINGS)
    case, levels = read_exported_folder(folder)
    handed_in = _read_solutions(levels, solutions, multipliers)
    scored = [scores.score_solution(case, solution) for solution in handed_in]
    rates = scores.compute_rates(case, scored)
    verdict = scores.state_verdict(scored, rates)
    if html is not None:
        with replacing(html) as temporary:
            from unilateral.exchange.page import render_score_page

            temporary.write_text(render_score_page(case, scored, rates), encoding="utf-8", newline="\n")
    if json:
        record = {
            "case": case.name,
            "verdict": verdict,
            "rates": {
                norm: _replace_nan(rate._asdict()) | {"verdict": rate.verdict} for norm, rate in rates.items()
            },
            "solutions": [_make_score_record(scored_solution) for scored_solution in scored],
        }
        print_result(dumps(record))
    else:
        lines = [
            *_format_error_table(case, scored),
            *_format_rates(case, scored, rates),
            scores.describe_finest_extremes(scored),
            *scores.list_fault_sentences(scored),
        ]
        print_result("\n".join([*filter(None, lines), f"{case.name}: {verdict}"]))
        if html is not None:
            print_result(f"  written: {html}, {format_file_size(html)}")
    return 0 if scores.passes_judgement(scored, rates) else EXIT_REJECTED


def _read_solutions(
    levels: list[ExportedLevel], solutions: Sequence[str], multipliers: Sequence[str]
) -> list[ForeignSolution]:
    """The solutions in these files, with the multipliers, if any, in those.

    Raises InputError where not every solution has a multiplier's file, and for two solutions on one level.
    """
    if multipliers and len(multipliers) != len(solutions):
        raise InputError(
            f"--multiplier is given {pluralise(len(multipliers), 'time')} for "
            f"{pluralise(len(solutions), 'solution')}; repeat it for each solution"
        )
    handed_in = [read_foreign_solution(levels, *files) for files in zip_longest(solutions, multipliers)]
    first_on: dict[str, str] = {}
    for solution in handed_in:
        first = first_on.setdefault(solution.level.name, solution.file)
        if first is not solution.file:
            raise InputError(
                f"{solution.file}: it is on {solution.level.name}, as {first} is; hand in one solution for "
                "each level"
            )
    return handed_in


def _make_score_record(scored_solution: ScoredSolution) -> dict[str, Any]:
    level = scored_solution.solution.level
    return {
        "file": scored_solution.solution.file,
        "level": level.name,
        "h": level.mesh.h,
        "H": level.partition.H,
        "multiplier": scored_solution.solution.multiplier_kind,
        "errors": _replace_nan(scored_solution.errors._asdict()),
        "own_errors": _replace_nan(scored_solution.reference_errors._asdict()),
        "faults": scored_solution.faults,
        "remarks": scored_solution.diagnosis.remarks,
        "conditions": scored_solution.extremes.as_numbers() if scored_solution.extremes else None,
    }


def _replace_nan(values: dict[str, float]) -> dict[str, float | None]:
    """The numbers, null where they are not known."""
    return {name: None if math.isnan(value) else value for name, value in values.items()}


def _format_error_table(case: Problem, scored_solutions: list[ScoredSolution]) -> Iterator[str]:
    """The errors, with this project's own below them."""
    u_title = f"u in {FORM_AND_NORM_NAMES[case.c != ZERO][1]}"
    yield f"{'level':10} {'h':>9} {u_title:>10} {'lambda in H^(-1/2)':>22} {'in L2':>10}  multiplier"
    for scored in scored_solutions:
        rows = (
            (scored.errors, scored.solution.level.name, scored.solution.multiplier_kind),
            (scored.reference_errors, "  own", "constant on cells"),
        )
        for errors, name, kind in rows:
            h1, dual, l2 = scores.format_errors(errors)
            numbers = f"{scored.solution.level.mesh.h:9.4g} {h1:>10} {dual:>22} {l2:>10}"
            yield f"{name:10} {numbers}  {kind}"


def _format_rates(
    case: Problem, scored_solutions: Sequence[ScoredSolution], rates: dict[str, Rate]
) -> Iterator[str]:
    """A line on the rate in each norm."""
    for norm, rate in rates.items():
        if rate.pairs:
            proved = "" if math.isnan(rate.proved) else f", proved {rate.proved:g}"
            numbers = f"{rate.observed:.2f} ({pluralise(rate.pairs, 'pair')}), own {rate.own:.2f}{proved}"
            yield f"rate in {norm:5} {numbers}: {rate.verdict}"
        else:
            reason = scores.explain_missing_rate(case, scored_solutions, norm)
            yield f"rate in {norm:5} {rate.verdict}: {reason}"
