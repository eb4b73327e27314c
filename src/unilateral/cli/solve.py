"""The command `unilateral solve`: a case or a problem, on given sizes or up to an accuracy."""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from unilateral import api
from unilateral.adaptive import loop
from unilateral.adaptive.goal import DEFAULT_ACCURACY, ERROR_NORMS
from unilateral.adaptive.level import Level
from unilateral.adaptive.loop import BOUNDS_WITHDRAWN, Search
from unilateral.certificates.export import CERTIFICATE_ENDINGS, find_checker
from unilateral.certificates.statement import state_problem
from unilateral.cli.guard import EXIT_NOT_CONVERGED, print_message, print_result
from unilateral.cli.mesh_options import read_mesh_option
from unilateral.cli.report import (
    MAX_FORCE_SIDES,
    NORMS_WITH_COEFFICIENTS,
    WITHOUT_REACTION,
    ForceRow,
    describe_ending,
    describe_plan,
    format_file_row,
    format_first_level,
    format_forecast,
    format_head,
    format_level,
    format_result,
)
from unilateral.errors import InputError, pluralise
from unilateral.formulas.decimals import format_interval, interval_record
from unilateral.formulas.expression import ONE, ZERO
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem
from unilateral.solution.bounds import Bounds, explain_memory_shortage, name_energy_norm
from unilateral.solution.files import SOLUTION_ENDINGS
from unilateral.solution.record import make_solution_record
from unilateral.solution.shortfalls import (
    explain_dominant_lift,
    explain_flat_triangles,
    explain_nonconvergence,
    explain_nonuniqueness,
)
from unilateral.solution.solution import Solution
from unilateral.solvers.stop import Stop
from unilateral.system import json_records
from unilateral.system.files import check_target, make_write_error
from unilateral.system.memory import keep_freed_memory, peak_mb
from unilateral.system.optional import find_missing_packages, require
from unilateral.system.signals import EXIT_INTERRUPTED

DEFAULT_ACCURACY_NOTE = f"no sizes and no accuracy are given; using --accuracy {DEFAULT_ACCURACY:g}"
TOO_COARSE_HINT = (
    "the bound allows an error as large as u itself; "
    f"--accuracy {DEFAULT_ACCURACY:g} instead of --h and --H refines the mesh where the bound is large"
)
MIN_ANNOUNCED_SECONDS = 5.0
"""A level that is expected to take this many seconds is announced on a terminal."""
MAX_DUAL_ERROR_CELLS = 512
"""Up to this many cells the error in H^{-1/2} is computed; for more it takes longer than all the rest."""
OUT_FOLDER_FILES = ("solution.vtu", "boundary.csv", "solution.nc", "certificate.json", "solution.svg")
"""The names of the files in the folder of --out."""


def run_solve(options: SimpleNamespace) -> int:
    """Solve and report; the exit code. The `options` are those of the command, as click reads them."""
    sharp = options.sharp or options.norm != "h1"
    files = check_target_files(options.output, options.out, options.certificate)
    keep_freed_memory()
    problem = _read_problem(options)
    if options.certificate:
        state_problem(problem)  # refuses what a certificate cannot state
    stop_options = {name: getattr(options, name) for name in ("tolerance", "max_steps", "algorithm", "rho")}
    solution = api.solve(
        problem,
        options.h,
        options.H,
        options.accuracy,
        norm=options.norm,
        sides=options.sides,
        mesh=_read_mesh_or_kind(options.mesh, problem),
        stop=Stop(**stop_options),
        max_unknowns=options.max_unknowns,
        max_seconds=options.max_seconds,
        max_memory=options.max_memory,
        sharp=sharp,
        absolute=options.absolute,
        dry_run=options.dry_run,
        tell=None if options.json else make_level_printer(problem, options.by_default),
        begin=options.begin,
    )
    search = solution.search
    interrupted = search is not None and search.ended == loop.ENDED_BY_INTERRUPT
    if search is not None and options.dry_run:
        print_result(describe_plan(problem.name, search, options.json))
        return EXIT_INTERRUPTED if interrupted else 0
    is_user_mesh = options.mesh not in (None, *api.MESH_KINDS)
    record, interrupted = report_solution(
        solution, sharp, options.json, is_user_mesh, options.begin, interrupted
    )
    # Ctrl-C ends this at once, also after a search that it has ended
    write_files(solution, record, files, options.certificate, sharp, options.json)
    if interrupted:
        return EXIT_INTERRUPTED
    return 0 if (solution.certified if search else solution.converged) else EXIT_NOT_CONVERGED


def run_certify(options: SimpleNamespace) -> int:
    """Bound the errors of another program's solution; the exit code."""
    files = check_target_files(options.output, None, options.certificate)
    problem = api.load(options.problem)
    if options.certificate:
        state_problem(problem)  # refuses what a certificate cannot state
    if options.mesh is None and Path(options.solution).suffix in (".csv", ".nc"):
        raise InputError(f"--mesh is missing, because {options.solution} has no triangles")
    file = options.mesh or options.solution
    mesh = read_mesh_option(file, problem.polygon, "--mesh" if options.mesh else "--solution", corners=True)
    from unilateral.exchange.exported_folder import read_field_at_nodes

    u = read_field_at_nodes(mesh, file, options.solution, options.field)
    solution = api.certify(problem, mesh, u)
    record, _ = report_solution(solution, options.sharp, options.json, is_user_mesh=True, begin=options.begin)
    write_files(solution, record, files, options.certificate, options.sharp, options.json)
    return 0 if record["h1_bound"] < math.inf else EXIT_NOT_CONVERGED


def _read_problem(options: SimpleNamespace) -> Problem:
    """The problem or the case that the options name, with its free sides."""
    name = options.problem
    problem = problem_file.load_if_problem(name)
    if problem is not None:
        for option in ("polygon", "side", "free_sides"):
            if getattr(options, option) is not None:
                raise InputError(f"--{option.replace('_', '-')} is for cases; {name} declares a problem")
        return problem.make_idle_sides_free() if options.leave_out_idle_sides else problem
    if options.leave_out_idle_sides:
        raise InputError("--leave-out-idle-sides is for problem files; for a case use --free-sides")
    return api.case(name, options.polygon, options.side or 0, options.free_sides or ())


def _read_mesh_or_kind(kind_or_file: str | None, problem: Problem) -> Any:
    """The kind of mesh, or the mesh in a file of that name."""
    if kind_or_file is None or kind_or_file in api.MESH_KINDS:
        return kind_or_file or ""
    if not Path(kind_or_file).is_file():
        raise InputError(
            f"argument --mesh: '{kind_or_file}' is neither structured nor unstructured nor a file"
        )
    return read_mesh_option(kind_or_file, problem.polygon)


def make_level_printer(problem: Problem, is_default_accuracy: bool) -> Callable[[Level], None]:
    """A function that prints each level, the first one below a line with the accuracy that is asked for.

    On a terminal it announces a next level that is expected to take long.
    """
    is_first = True

    def print_level(level: Level) -> None:
        """Prints the row of a level."""
        nonlocal is_first
        if is_first and is_default_accuracy:
            print_result(DEFAULT_ACCURACY_NOTE)
        print_result(format_first_level(problem, level) if is_first else format_level(level))
        is_first = False
        if level.next_seconds >= MIN_ANNOUNCED_SECONDS and sys.stderr.isatty():
            print(format_forecast(level), file=sys.stderr, flush=True)

    return print_level


def report_solution(
    solution: Solution,
    sharp: bool,
    json: bool,
    is_user_mesh: bool,
    begin: float,
    interrupted: bool = False,
) -> tuple[dict[str, Any], bool]:
    """Print a solution, as text or as `json`; its record, and whether there was an interrupt.

    After an interrupt true errors and forces are left out. One while they are computed ends this only where
    no accuracy was asked for. Seconds count from `begin` on.
    """
    search = solution.search
    bounds = None
    if refusal := explain_memory_shortage(solution, sharp):
        print_message(refusal)
    else:
        bounds = solution.sharp_bounds if sharp else solution.bounds
    if search:
        _print_ending(search, solution.problem, json)
    # true errors and forces take long, and Ctrl-C after a search leaves them out
    errors = None
    forces = []
    if not interrupted:
        try:
            with_dual = solution.partition.n_cells <= MAX_DUAL_ERROR_CELLS and not find_missing_packages(
                "gmsh"
            )
            errors = solution.true_errors(with_dual)
            forces = list_force_rows(solution, sharp) if bounds else []
        except KeyboardInterrupt:
            if search is None:
                raise
            interrupted = True
    record = make_solution_record(solution, bounds, errors, sharp) | {
        "forces": {row.name: interval_record(*row.force) for row in forces} or None,
        "seconds": time.perf_counter() - begin,
        "peak_mb": peak_mb(),
    }
    doubt = "" if solution.unique else explain_nonuniqueness(solution.mesh, is_user_mesh)
    _print_shortfalls(solution, doubt, bounds is not None and not sharp)
    if json:
        print_result(json_records.encode_json(record))
        return record, interrupted
    _print_norms(solution, record)
    norms_below = {
        norm: solution.bounded.norm_lower_bound(norm, sharp) if bounds else math.nan for norm in ERROR_NORMS
    }
    print_result(format_result(record, bounds, norms_below, forces, doubt, solution.problem))
    if bounds and not (search or errors or solution.solved.is_foreign) and is_too_coarse(solution, bounds):
        print_result(f"  {'hint':27} {TOO_COARSE_HINT}")
    return record, interrupted


def _print_ending(search: Search, problem: Problem, json: bool) -> None:
    """Print what a search refused or withdrew and, unless `json` is printed, how it ended."""
    if search.refusal is not None:
        print_message(search.refusal)
    withdrawn = len(search.levels) - len(search.believed)
    if withdrawn:
        print_message(f"{pluralise(withdrawn, 'bound')} {BOUNDS_WITHDRAWN}")
    if not json:
        print_result(describe_ending(search, problem))


def _print_shortfalls(solution: Solution, doubt: str, has_cheap_bounds: bool) -> None:
    """Print what a solution lacks: `doubt` on its lambda_H, flat triangles, convergence, a feasible u_h."""
    if doubt:
        print_message(f"lambda_H {doubt}")
    # flat triangles make the cheap bound large; where it certifies the accuracy that is no matter
    is_certified = solution.search is not None and solution.certified
    if has_cheap_bounds and not is_certified and (flat := explain_flat_triangles(solution.bounded)):
        print_message(flat)
    if not (solution.search or solution.converged):
        print_message(explain_nonconvergence(solution.solved))
    if reason := explain_dominant_lift(solution):
        print_message(reason)


def _print_norms(solution: Solution, record: dict[str, Any]) -> None:
    """Print the head of a solve without a search, whose u it is, and what ||.||_1 means for its k and c."""
    problem = solution.problem
    if not solution.search:
        print_result(format_head(record))
    if solution.solved.is_foreign:
        print_result(f"  {'u':27} of another program; lambda_H and the contact set are this program's")
    if problem.c == ZERO:
        print_result(f"  {WITHOUT_REACTION.format(name_energy_norm(problem, 'v'))}")
    elif not problem.k == problem.c == ONE:
        print_result(f"  {NORMS_WITH_COEFFICIENTS}")


def is_too_coarse(solution: Solution, bounds: Bounds) -> bool:
    """Whether the mesh alone may be the reason that the bound is not below the norm of u.

    A u_h that is 0 has no relative error, whatever the mesh.
    """
    return solution.converged and solution.unique and solution.solved.u_norm > 0 and not bounds.relative_u < 1


def list_force_rows(solution: Solution, sharp: bool) -> list[ForceRow]:
    """The forces over the boundary and over each side with multipliers, and the reactions on clamped sides.

    There are none for more than MAX_FORCE_SIDES sides, and where all are free.
    """
    if solution.mesh.polygon.n_sides > MAX_FORCE_SIDES:
        return []
    forces = solution.forces(sharp)
    contact_sides = np.unique(solution.partition.side[solution.solved.cells])
    rows = [ForceRow("boundary", "force, boundary", forces.whole)] if contact_sides.size else []
    label = solution.polygon.label_side
    for side in contact_sides.tolist():
        rows.append(ForceRow(f"side_{side}", f"force, side {label(side)}", forces.sides[side]))
    for sides, reaction in forces.reactions.items():
        numbers = [str(side) for side in sides]
        text = f"reaction, side{'s' * (len(sides) > 1)} {', '.join(map(label, sides))}"
        rows.append(ForceRow("_".join(["reaction", *numbers]), text, reaction))
    if forces.total and contact_sides.size + len(forces.reactions) > 1:
        rows.append(ForceRow("forces_and_reactions", "sum of forces, reactions", forces.total))
    return rows


def check_target_files(names: Sequence[str], folder: str | None, certificate: str | None) -> list[Path]:
    """The files of -o and those in the folder of --out, which is made.

    Raises InputError for one of these, or a certificate, that cannot be written.
    """
    files = [Path(name) for name in names]
    if certificate:
        check_target(certificate, CERTIFICATE_ENDINGS)
    for file in files:
        check_target(file, SOLUTION_ENDINGS)
    if folder is None:
        return files
    require(
        "--out needs",
        *{package for name in OUT_FOLDER_FILES for package in SOLUTION_ENDINGS[Path(name).suffix]},
    )
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise make_write_error(place, error) from error
    inside = [place / name for name in OUT_FOLDER_FILES]
    for file in inside:
        check_target(file, SOLUTION_ENDINGS)
    return inside + files


def write_files(
    solution: Solution,
    record: dict[str, Any],
    files: Sequence[Path],
    certificate: str | None,
    sharp: bool,
    json: bool,
) -> None:
    """Write the files, and print a row for each unless `json` is printed; .json has the record."""
    for file in files:
        if file.suffix == ".json":
            json_records.write_json(record, file)
        else:
            solution.save(file)
        if not json:
            print_result(format_file_row(file))
    if certificate is None:
        return
    solution.save_certificate(certificate)
    if not json:
        print_result(format_file_row(Path(certificate)))
        check = shlex.join(["python3", str(find_checker(solution.problem)), certificate])
        print_result(f"  {'check it with':27} {check}")
        if sharp:
            bound = format_interval(-math.inf, solution.bounded.total_bound("h1"))
            print_result(f"  {'it proves':27} the bound without --sharp: {bound}")
