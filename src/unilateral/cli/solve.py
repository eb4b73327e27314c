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
from unilateral.adaptive.goal import ACCURACY, NORMS
from unilateral.adaptive.level import Level
from unilateral.adaptive.loop import WITHDRAWN
from unilateral.certificates.export import CERTIFICATE_ENDINGS, checker_of
from unilateral.certificates.statement import state_problem
from unilateral.cli.guard import NOT_CONVERGED, say, tell
from unilateral.cli.own_mesh import own_mesh
from unilateral.cli.report import (
    NORMS_WITH_COEFFICIENTS,
    SIDES,
    WITHOUT_REACTION,
    ForceRow,
    ending,
    head,
    level_head,
    level_line,
    next_line,
    planned,
    table,
    written,
)
from unilateral.errors import InputError, counted
from unilateral.formulas.decimals import fields, interval
from unilateral.formulas.expression import ONE, ZERO
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem
from unilateral.solution.bounds import Bounds, energy, too_large
from unilateral.solution.faults import flat_triangles, lift_dominates, not_converged, not_unique
from unilateral.solution.files import ENDINGS
from unilateral.solution.record import record as record_of
from unilateral.solution.solution import Solution
from unilateral.solvers.stop import Stop
from unilateral.system import as_json
from unilateral.system.files import check_target, writing_failed
from unilateral.system.memory import keep_freed, peak_mb
from unilateral.system.optional import lacking, require
from unilateral.system.signals import INTERRUPTED

BY_DEFAULT = f"no sizes and no accuracy are given; using --accuracy {ACCURACY:g}"
TOO_COARSE = (
    "the bound does not rule out an error as large as u itself; "
    f"--accuracy {ACCURACY:g} in place of --h and --H refines the mesh where the bound comes from"
)
LONG = 5.0
"""A level that is expected to take this many seconds is announced on a terminal."""
FEW = 512
"""Up to this many cells the error in H^{-1/2} is computed; for more it takes longer than all the rest."""
KEPT = ("solution.vtu", "boundary.csv", "solution.nc", "certificate.json", "solution.svg")
"""The names of the files in the folder of --out."""


def run(options: SimpleNamespace) -> int:
    """Solve and report; the exit code. The `options` are those of the command, as click reads them."""
    sharp = options.sharp or options.norm == "hm12"
    files = target_files(options.output, options.out, options.certificate)
    keep_freed()
    problem = _problem(options)
    if options.certificate:
        state_problem(problem)  # refuses what a certificate cannot state
    solution = api.solve(
        problem,
        options.h,
        options.H,
        options.accuracy,
        norm=options.norm,
        mesh=_mesh(options.mesh, problem),
        stop=Stop(
            tolerance=options.tolerance,
            max_steps=options.max_steps,
            algorithm=options.algorithm,
            rho=options.rho,
        ),
        max_unknowns=options.max_unknowns,
        max_seconds=options.max_seconds,
        max_memory=options.max_memory,
        sharp=sharp,
        absolute=options.absolute,
        dry_run=options.dry_run,
        tell=None if options.json else level_printer(problem, options.by_default),
        begin=options.begin,
    )
    search = solution.search
    interrupted = search is not None and search.ended == loop.INTERRUPTED
    if search is not None and options.dry_run:
        say(planned(problem.name, search, options.json))
        return INTERRUPTED if interrupted else 0
    on_own_mesh = options.mesh not in (None, *api.KINDS)
    record, interrupted = report(solution, sharp, options.json, on_own_mesh, options.begin, interrupted)
    # Ctrl-C ends this at once, also after a search that it has ended
    write_files(solution, record, files, options.certificate, sharp, options.json)
    if interrupted:
        return INTERRUPTED
    return 0 if (solution.certified if search else solution.converged) else NOT_CONVERGED


def certify(options: SimpleNamespace) -> int:
    """Bound the errors of another program's solution; the exit code."""
    files = target_files(options.output, None, options.certificate)
    problem = api.load(options.problem)
    if options.certificate:
        state_problem(problem)  # refuses what a certificate cannot state
    if options.mesh is None and Path(options.solution).suffix in (".csv", ".nc"):
        raise InputError(f"--mesh is missing, because {options.solution} has no triangles")
    file = options.mesh or options.solution
    mesh = own_mesh(file, problem.polygon, "--mesh" if options.mesh else "--solution", corners=True)
    from unilateral.exchange.exported_folder import nodal_values_on

    u = nodal_values_on(mesh, file, options.solution, options.field)
    solution = api.certify(problem, mesh, u)
    record, _ = report(solution, options.sharp, options.json, on_own_mesh=True, begin=options.begin)
    write_files(solution, record, files, options.certificate, options.sharp, options.json)
    return 0 if record["h1_bound"] < math.inf else NOT_CONVERGED


def _problem(options: SimpleNamespace) -> Problem:
    """What is to be solved, with its free sides."""
    name = options.problem
    problem = problem_file.problem_in(name)
    if problem is not None:
        for option in ("polygon", "side", "free_sides"):
            if getattr(options, option) is not None:
                raise InputError(f"--{option.replace('_', '-')} is for cases; {name} declares a problem")
        return problem.without_idle_sides() if options.leave_out_idle_sides else problem
    if options.leave_out_idle_sides:
        raise InputError("--leave-out-idle-sides is for problem files; for a case use --free-sides")
    return api.case(name, options.polygon, options.side or 0, options.free_sides or ())


def _mesh(kind_or_file: str | None, problem: Problem) -> Any:
    """The kind of mesh, or the mesh in a file of that name."""
    if kind_or_file is None or kind_or_file in api.KINDS:
        return kind_or_file or ""
    if not Path(kind_or_file).is_file():
        raise InputError(
            f"argument --mesh: '{kind_or_file}' is neither structured nor unstructured nor a file"
        )
    return own_mesh(kind_or_file, problem.polygon)


def level_printer(problem: Problem, by_default: bool) -> Callable[[Level], None]:
    """A function that prints each level, the first one below a line that says what is wanted.

    On a terminal it announces a next level that is expected to take long.
    """
    first = True

    def print_level(level: Level) -> None:
        nonlocal first
        if first and by_default:
            say(BY_DEFAULT)
        say(level_head(problem, level) if first else level_line(level))
        first = False
        if level.next_seconds >= LONG and sys.stderr.isatty():
            print(next_line(level), file=sys.stderr, flush=True)

    return print_level


def report(
    solution: Solution,
    sharp: bool,
    json: bool,
    on_own_mesh: bool,
    begin: float,
    interrupted: bool = False,
) -> tuple[dict[str, Any], bool]:
    """Print what was found, as text or as `json`; its record, and whether there was an interrupt.

    After an interrupt true errors and forces are left out. One while they are computed ends this only where
    no accuracy was asked for. Seconds count from `begin` on.
    """
    search = solution.search
    solved = solution.solved
    problem = solution.problem
    refusal = too_large(solution, sharp)
    bounds = None
    if refusal:
        tell(refusal)
    else:
        bounds = solution.sharp_bounds if sharp else solution.bounds
    if search:
        if search.refusal is not None:
            tell(search.refusal)
        withdrawn = len(search.levels) - len(search.believed)
        if withdrawn:
            tell(f"{counted(withdrawn, 'bound')} {WITHDRAWN}")
        if not json:
            say(ending(search, problem))
    errors = None
    forces = []
    if not interrupted:
        try:
            with_dual = solution.partition.n_cells <= FEW and not lacking("gmsh")
            errors = solution.true_errors(with_dual)
            forces = force_rows(solution, sharp) if bounds else []
        except KeyboardInterrupt:
            if search is None:
                raise
            interrupted = True
    record = record_of(solution, bounds, errors, sharp) | {
        "forces": {row.name: fields(*row.force) for row in forces} or None,
        "seconds": time.perf_counter() - begin,
        "peak_mb": peak_mb(),
    }
    doubt = "" if solution.unique else not_unique(solution.mesh, on_own_mesh)
    if doubt:
        tell(f"lambda_H {doubt}")
    is_certified = search is not None and solution.certified
    if bounds and not (sharp or is_certified) and (flat := flat_triangles(solution.bounded)):
        tell(flat)
    if not (search or solution.converged):
        tell(not_converged(solved))
    if reason := lift_dominates(solution):
        tell(reason)
    if json:
        say(as_json.text(record))
        return record, interrupted
    if not search:
        say(head(record))
    if solved.foreign:
        say(f"  {'u':27} of another program; lambda_H and the contact set are this program's")
    if problem.c == ZERO:
        say(f"  {WITHOUT_REACTION.format(energy(problem, 'v'))}")
    elif not problem.k == problem.c == ONE:
        say(f"  {NORMS_WITH_COEFFICIENTS}")
    least = {norm: solution.bounded.size(norm, sharp) if bounds else math.nan for norm in NORMS}
    say(table(record, bounds, least, forces, doubt, problem))
    if bounds and not (search or errors or solved.foreign) and is_too_coarse(solution, bounds):
        say(f"  {'hint':27} {TOO_COARSE}{'; it makes its own meshes' * on_own_mesh}")
    return record, interrupted


def is_too_coarse(solution: Solution, bounds: Bounds) -> bool:
    """Whether the mesh alone may be the reason that the bound is not below the norm of u.

    A u_h that is 0 has no relative error, whatever the mesh.
    """
    return solution.converged and solution.unique and solution.solved.u_norm > 0 and not bounds.relative_u < 1


def force_rows(solution: Solution, sharp: bool) -> list[ForceRow]:
    """The forces over the boundary and over each side with multipliers, and the reactions on clamped sides.

    There are none for more than SIDES sides, and where all are free.
    """
    if solution.mesh.polygon.n_sides > SIDES:
        return []
    forces = solution.forces(sharp)
    contact_sides = np.unique(solution.partition.side[solution.solved.cells])
    rows = [ForceRow("boundary", "force, boundary", forces.whole)] if contact_sides.size else []
    for side in contact_sides:
        rows.append(ForceRow(f"side_{side}", f"force, side {side}", forces.sides[side]))
    for sides, reaction in forces.reactions.items():
        numbers = [str(side) for side in sides]
        label = f"reaction, side{'s' * (len(sides) > 1)} {', '.join(numbers)}"
        rows.append(ForceRow("_".join(["reaction", *numbers]), label, reaction))
    if forces.total and contact_sides.size + len(forces.reactions) > 1:
        rows.append(ForceRow("forces_and_reactions", "sum of forces, reactions", forces.total))
    return rows


def target_files(names: Sequence[str], folder: str | None, certificate: str | None) -> list[Path]:
    """The files of -o and those in the folder of --out, which is made.

    Raises InputError for one of these, or a certificate, that cannot be written.
    """
    files = [Path(name) for name in names]
    if certificate:
        check_target(certificate, CERTIFICATE_ENDINGS)
    for file in files:
        check_target(file, ENDINGS)
    if folder is None:
        return files
    require("--out needs", *{package for name in KEPT for package in ENDINGS[Path(name).suffix]})
    place = Path(folder)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise writing_failed(place, error) from error
    inside = [place / name for name in KEPT]
    for file in inside:
        check_target(file, ENDINGS)
    return inside + files


def write_files(
    solution: Solution,
    record: dict[str, Any],
    files: Sequence[Path],
    certificate: str | None,
    sharp: bool,
    json: bool,
) -> None:
    """Write the files, each told when it is there unless `json` is printed; .json has the record."""
    for file in files:
        if file.suffix == ".json":
            as_json.write(record, file)
        else:
            solution.save(file)
        if not json:
            say(written(file))
    if certificate is None:
        return
    solution.save_certificate(certificate)
    if not json:
        say(written(Path(certificate)))
        check = shlex.join(["python3", str(checker_of(solution.problem)), certificate])
        say(f"  {'check it with':27} {check}")
        if sharp:
            bound = interval(-math.inf, solution.bounded.total("h1"))
            say(f"  {'it proves':27} the bound without --sharp: {bound}")
