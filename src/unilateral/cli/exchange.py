"""The commands `unilateral export` and `unilateral score`."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from unilateral import api
from unilateral.choice import check_size
from unilateral.cli.streams import say
from unilateral.errors import InputError
from unilateral.exchange import export as exports
from unilateral.exchange import score as scores
from unilateral.exchange.read import exported, foreign
from unilateral.exchange.score import Rate, Scored
from unilateral.geometry.structured import natural_kind
from unilateral.problems import problem_file

MOST_LEVELS = 12


def export(options: argparse.Namespace) -> int:
    """Write a case as files; the exit code."""
    if problem_file.is_declared_in(options.case):
        raise InputError(f"{options.case} declares a problem; only a case has the solution to score by")
    if (options.h is None) == (options.mesh is None):
        raise InputError("export needs either --h or --mesh")
    if options.levels > MOST_LEVELS:
        raise InputError(f"argument --levels: {options.levels} is more than {MOST_LEVELS}")
    case = api.case(options.case)
    if options.mesh is None:
        check_size(case.polygon, options.h)
        coarsest = options.h * 2 ** (options.levels - 1)
        mesh = api.KINDS[natural_kind(case.polygon)](case.polygon, coarsest)
    elif not Path(options.mesh).is_file():
        raise InputError(f"argument --mesh: there is no file '{options.mesh}'")
    else:
        mesh = api.mesh(options.mesh, case.polygon)
    exports.export(case, mesh, options.H, options.levels, options.out)
    say(f"{case.name}: {options.levels} levels in {options.out}")
    return 0


def score(options: argparse.Namespace) -> int:
    """Print the errors, rates and faults of another solver's solutions; the exit code."""
    case, levels = exported(options.folder)
    multipliers = options.multiplier or [None] * len(options.solutions)
    if len(multipliers) != len(options.solutions):
        raise InputError(
            f"--multiplier names {len(multipliers)} files for {len(options.solutions)} solutions"
        )
    given = [foreign(levels, *files) for files in zip(options.solutions, multipliers, strict=True)]
    scored = [scores.score(case, each) for each in given]
    rates = scores.rates(case, scored)
    verdict = scores.verdict(scored, rates)
    if options.json:
        found = {"case": case.name, "verdict": verdict, "rates": {n: _rate(r) for n, r in rates.items()}}
        say(json.dumps(found | {"solutions": [_solution(each) for each in scored]}))
    else:
        say("\n".join([*_table(scored), *_lines(rates), *_faults(scored), f"{case.name}: {verdict}"]))
    return 0


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
    }


def _rate(rate: Rate) -> dict[str, Any]:
    return _numbers(rate._asdict()) | {"verdict": rate.verdict}


def _numbers(found: dict[str, float]) -> dict[str, float | None]:
    """Null where not known."""
    return {name: None if math.isnan(value) else value for name, value in found.items()}


def _table(scored: list[Scored]) -> Iterator[str]:
    """Errors, this project's own below them."""
    yield f"{'level':10} {'h':>9} {'u in H1':>10} {'lambda in H^(-1/2)':>22} {'in L2':>10}  multiplier"
    for one in scored:
        rows = ((one.errors, one.given.level.name, one.given.kind), (one.own, "  own", "constant on cells"))
        for errors, name, kind in rows:
            dual = f"{errors.hm12_lower:.4g} to {errors.hm12_upper:.4g}"
            numbers = f"{one.given.level.mesh.h:9.4g} {errors.h1:10.4g} {dual:>22} {errors.l2:10.4g}"
            yield f"{name:10} {numbers}  {kind}"


def _lines(rates: dict[str, Rate]) -> Iterator[str]:
    """A line per norm."""
    for norm, rate in rates.items():
        numbers = f"{rate.observed:.2f} ({rate.pairs} pairs), own {rate.own:.2f}, proved {rate.proved:g}"
        yield f"rate in {norm:5} {numbers}: {rate.verdict}"


def _faults(scored: list[Scored]) -> Iterator[str]:
    for one in scored:
        yield from (f"{one.given.file}: {fault}" for fault in one.faults)
