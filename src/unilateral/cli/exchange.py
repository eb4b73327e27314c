"""The commands `unilateral export` and `unilateral score`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from json import dumps
from pathlib import Path
from typing import Any

from unilateral import api
from unilateral.cli.guard import DOES_NOT_HOLD, say, tell
from unilateral.cli.own_mesh import mesh_of_size, own_mesh
from unilateral.discrete.choice import check_size
from unilateral.errors import InputError, counted
from unilateral.exchange import export as exports
from unilateral.exchange import score as scores
from unilateral.exchange.equation_residual import NAMES
from unilateral.exchange.exported_folder import exported, foreign
from unilateral.exchange.score import Rate, Scored
from unilateral.formulas.expression import ZERO
from unilateral.geometry.partition import uniform
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem
from unilateral.system.files import check_target, replacing, sized

MOST_LEVELS = 12
PAGES = {".html": ["matplotlib"], ".htm": ["matplotlib"]}
"""The endings of pages with plots, and what draws these."""


def export(
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
    if problem_file.is_declared_in(case):
        raise InputError(f"{case} declares a problem; only a case has a known solution to compare with")
    if levels > MOST_LEVELS:
        raise InputError(f"argument --levels: {levels} is more than {MOST_LEVELS}")
    problem = api.case(case, polygon, side, free_sides or ())
    if mesh is not None:
        coarse = own_mesh(mesh, problem.polygon)
    elif h is not None:
        check_size(problem.polygon, h)
        coarse = mesh_of_size(problem.polygon, h * 2 ** (levels - 1))
    exports.export(problem, coarse, H, levels, out)
    if coarse.h / 2 ** (levels - 1) >= uniform(problem.polygon, H).H:
        tell("the multiplier may not be unique, because h >= H; take h < H, such as H = 2h")
    say(f"{problem.name}: {counted(levels, 'level')} in {out}")
    for folder in (Path(out), *sorted(file for file in Path(out).iterdir() if file.is_dir())):
        files = sorted(file for file in folder.iterdir() if file.is_file())
        say(f"  {folder}: {', '.join(file.name for file in files)}; {sized(*files)}")


def score(
    folder: str, solutions: Sequence[str], multipliers: Sequence[str], html: str | None, json: bool
) -> int:
    """Print the errors, rates and faults of another solver's solutions; the exit code."""
    if html is not None:
        check_target(html, PAGES)
    case, levels = exported(folder)
    if multipliers and len(multipliers) != len(solutions):
        raise InputError(
            f"--multiplier is given {counted(len(multipliers), 'time')} for "
            f"{counted(len(solutions), 'solution')}; repeat it for each solution"
        )
    given = [foreign(levels, *each) for each in zip_longest(solutions, multipliers)]
    first_on: dict[str, str] = {}
    for each in given:
        first = first_on.setdefault(each.level.name, each.file)
        if first is not each.file:
            raise InputError(
                f"{each.file}: it is on {each.level.name}, as {first} is; hand in one solution for each level"
            )
    scored = [scores.score(case, each) for each in given]
    rates = scores.rates(case, scored)
    verdict = scores.verdict(scored, rates)
    if html is not None:
        with replacing(html) as temporary:
            from unilateral.exchange.page import page

            temporary.write_text(page(case, scored, rates), encoding="utf-8", newline="\n")
    if json:
        judged = {
            "case": case.name,
            "verdict": verdict,
            "rates": {n: _numbers(rate._asdict()) | {"verdict": rate.verdict} for n, rate in rates.items()},
            "solutions": [_solution(each) for each in scored],
        }
        say(dumps(judged))
    else:
        told = [
            *_table(case, scored),
            *_lines(case, scored, rates),
            scores.at_boundary(scored),
            *scores.sentences(scored),
        ]
        say("\n".join([*filter(None, told), f"{case.name}: {verdict}"]))
        if html is not None:
            say(f"  written: {html}, {sized(html)}")
    return 0 if scores.holds(scored, rates) else DOES_NOT_HOLD


def _solution(one: Scored) -> dict[str, Any]:
    level = one.given.level
    return {
        "file": one.given.file,
        "level": level.name,
        "h": level.mesh.h,
        "H": level.cells.H,
        "multiplier": one.given.kind,
        "errors": _numbers(one.errors._asdict()),
        "own_errors": _numbers(one.own._asdict()),
        "faults": one.faults,
        "remarks": one.told.remarks,
        "conditions": one.extremes.as_numbers() if one.extremes else None,
    }


def _numbers(found: dict[str, float]) -> dict[str, float | None]:
    """The numbers, null where they are not known."""
    return {name: None if math.isnan(value) else value for name, value in found.items()}


def _table(case: Problem, scored: list[Scored]) -> Iterator[str]:
    """The errors, with this project's own below them."""
    of_u = f"u in {NAMES[case.c != ZERO][1]}"
    yield f"{'level':10} {'h':>9} {of_u:>10} {'lambda in H^(-1/2)':>22} {'in L2':>10}  multiplier"
    for one in scored:
        rows = ((one.errors, one.given.level.name, one.given.kind), (one.own, "  own", "constant on cells"))
        for errors, name, kind in rows:
            h1, dual, l2 = scores.texts(errors)
            numbers = f"{one.given.level.mesh.h:9.4g} {h1:>10} {dual:>22} {l2:>10}"
            yield f"{name:10} {numbers}  {kind}"


def _lines(case: Problem, scored: Sequence[Scored], rates: dict[str, Rate]) -> Iterator[str]:
    """A line on the rate in each norm."""
    for norm, rate in rates.items():
        if rate.pairs:
            proved = "" if math.isnan(rate.proved) else f", proved {rate.proved:g}"
            numbers = f"{rate.observed:.2f} ({counted(rate.pairs, 'pair')}), own {rate.own:.2f}{proved}"
            yield f"rate in {norm:5} {numbers}: {rate.verdict}"
        else:
            yield f"rate in {norm:5} {rate.verdict}: {scores.why_not_judged(case, scored, norm)}"
