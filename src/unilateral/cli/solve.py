"""The command `unilateral solve`: a case or a problem, on given sizes or up to an accuracy."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from unilateral import api
from unilateral.accuracy.level import MAX_SECONDS, Level
from unilateral.accuracy.search import INTERRUPTED as BY_USER
from unilateral.accuracy.search import Search
from unilateral.choice import bound_mb
from unilateral.cli.report import NOT_UNIQUE, ending, head, level_head, level_line, table
from unilateral.cli.streams import say, tell
from unilateral.errors import InputError
from unilateral.memory import available_mb, peak_mb
from unilateral.problems import problem_file
from unilateral.problems.case import Case
from unilateral.problems.problem import Problem
from unilateral.solution import Bounds, Solution
from unilateral.solvers.iterate import Stop

NOT_CONVERGED, INTERRUPTED = 3, 130
FEW = 512
"""Cells up to which the error in H^{-1/2} is computed; for more it takes longer than all the rest."""
SIDES = 12
"""Up to which the forces are computed and printed."""


def run(options: argparse.Namespace) -> int:
    """Solve and report; the exit code."""
    begin = time.perf_counter()
    problem, sharp = _problem(options), options.sharp or options.norm == "hm12"
    found = api.solve(
        problem,
        options.h,
        options.H,
        options.accuracy,
        norm=options.norm or "h1",
        mesh=_mesh(options.mesh, problem),
        stop=Stop(
            tolerance=options.tolerance,
            max_steps=options.max_steps,
            algorithm=options.algorithm,
            rho=options.rho,
        ),
        max_unknowns=options.max_unknowns or math.inf,
        max_seconds=options.max_seconds or MAX_SECONDS,
        max_memory=options.max_memory or math.inf,
        sharp=sharp,
        tell=None if options.json else _told(problem.name),
    )
    search = found.search
    needed, free = 0.0 if search else bound_mb(found.mesh, sharp), available_mb()
    if needed > free:
        tell(f"no guaranteed bound, for it takes about {needed:.0f} MB, and {free:.0f} MB are free")
        bounds = None
    else:
        bounds = found.sharp_bounds if sharp else found.bounds
    unique = bool(search) or found.solved.discrete.unique
    if search:
        _tell_faults(search)
    if not unique:
        tell(f"lambda_H {NOT_UNIQUE}")
    printed = _printed(found, bounds, sharp)
    printed["seconds"] = time.perf_counter() - begin
    printed["peak_mb"] = peak_mb()
    if not options.json:
        say(ending(search) if search else head(printed))
    say(table(printed, found.solved.result, bounds, options.json, unique))
    if search and search.ended == BY_USER:
        return INTERRUPTED
    return 0 if printed["converged"] else NOT_CONVERGED


def _problem(options: argparse.Namespace) -> Case | Problem:
    """What is to be solved, with its free sides."""
    name = options.problem
    if problem_file.is_declared_in(name):
        for option in ("polygon", "side", "free_sides"):
            if getattr(options, option) is not None:
                raise InputError(f"--{option.replace('_', '-')} is for cases; {name} declares a problem")
        problem = problem_file.load(name)
        return problem.without_idle_sides() if options.leave_out_idle_sides else problem
    if options.leave_out_idle_sides:
        raise InputError("--leave-out-idle-sides is for problem files; of a case name --free-sides")
    return api.case(name, options.polygon, options.side or 0, options.free_sides or ())


def _mesh(given: str | None, problem: Case | Problem) -> Any:
    """The kind of mesh, or the mesh in a file of that name."""
    if given in (None, "structured", "unstructured"):
        return given or ""
    if not Path(given).is_file():
        raise InputError(f"argument --mesh: '{given}' is neither structured nor unstructured nor a file")
    return api.mesh(given, problem.polygon)


def _told(name: str) -> Callable[[Level], None]:
    """Prints each level when it is done, the first one below what is wanted."""
    first = True

    def one(level: Level) -> None:
        nonlocal first
        say(level_head(name, level) if first else level_line(level))
        first = False

    return one


def _tell_faults(search: Search) -> None:
    if search.refusal is not None:
        tell(search.refusal)
    if len(search.believed) < len(search.done):
        withdrawn = len(search.done) - len(search.believed)
        tell(f"{withdrawn} bounds withdrawn, for they contradict each other; please report it")


def _printed(found: Solution, bounds: Bounds | None, sharp: bool) -> dict[str, Any]:
    """What --json prints, but for the cost."""
    discrete, search = found.solved.discrete, found.search
    errors = found.errors if found.partition.n_cells <= FEW else found.true_errors(dual=False)
    return {
        "problem": discrete.data.name if discrete.data else None,
        "h": found.mesh.h,
        "diameter": found.mesh.diameter,
        "H": found.partition.H,
        "unknowns": found.mesh.n_nodes,
        "multipliers": len(discrete.cells),
        "iterations": found.iterations,
        "converged": found.certified if search else found.converged,
        "algebraic_bound": found.solved.result.bound,
        "h1_error": errors.h1 if errors else math.nan,
        "hm12_error_lower": errors.hm12_lower if errors else math.nan,
        "hm12_error_upper": errors.hm12_upper if errors else math.nan,
        "l2_error": errors.l2 if errors else math.nan,
        "total_bound": (search.best.total if search else bounds.u) if bounds else math.nan,
        "forces": _forces(found, sharp) if bounds else None,
    }


def _forces(found: Solution, sharp: bool) -> dict[str, dict[str, float]] | None:
    """Over the whole boundary, and over each side with multipliers."""
    n_sides, cells = found.mesh.polygon.n_sides, found.partition
    if n_sides > SIDES:
        return None
    held = np.unique(cells.side[found.solved.discrete.cells])
    forces = found.forces(sharp)
    sides = {f"side_{i}": forces.sides[i]._asdict() for i in held}
    return {"boundary": forces.whole._asdict()} | sides
