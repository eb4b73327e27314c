"""The command `unilateral solve`: a case or a problem, on given sizes or up to an accuracy."""

from __future__ import annotations

import math
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from unilateral import api
from unilateral.adaptive import loop
from unilateral.adaptive.goal import ACCURACY, NORMS
from unilateral.adaptive.level import Level
from unilateral.adaptive.loop import WITHDRAWN, Search
from unilateral.certificates.export import CERTIFICATE_ENDINGS, checker_of
from unilateral.certificates.statement import state_problem
from unilateral.cli.guard import NOT_CONVERGED, say, tell
from unilateral.cli.own_mesh import own_mesh
from unilateral.cli.report import (
    NORMS_WITH_COEFFICIENTS,
    SIDES,
    WITHOUT_REACTION,
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
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem
from unilateral.solution.certificate import Bounds, energy, record, too_large
from unilateral.solution.solution import (
    ENDINGS,
    Solution,
    flat_triangles,
    lift_dominates,
    not_converged,
    not_unique,
)
from unilateral.solvers.stop import Stop
from unilateral.system import as_json
from unilateral.system.files import check_target, writing_failed
from unilateral.system.memory import keep_freed, peak_mb
from unilateral.system.optional import require

INTERRUPTED = 130
LIMITS = ("max_unknowns", "max_seconds", "max_memory")
PASSED_ON = ("h", "H", "accuracy", "norm", "sharp", "absolute", "dry_run", *LIMITS)
OF_STOP = ("tolerance", "max_steps", "algorithm", "rho")
"""Options that are arguments of `api.solve` and of `Stop`, by the same names."""
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
    """Solve and report; the exit code."""
    options.sharp = options.sharp or options.norm == "hm12"
    _targets(options)
    keep_freed()
    problem = _problem(options)
    if options.certificate:
        state_problem(problem)
    solution = _solved(options, problem)
    interrupted = solution.search is not None and solution.search.ended == loop.INTERRUPTED
    if options.dry_run and solution.search:
        say(planned(problem.name, solution.search, options.json))
        return INTERRUPTED if interrupted else 0
    printed, interrupted = _reported(solution, options, interrupted)
    _keep(solution, options, printed)  # Ctrl-C ends this at once, also after a search that it has ended
    if interrupted:
        return INTERRUPTED
    return 0 if (solution.certified if solution.search else solution.converged) else NOT_CONVERGED


def certify(options: SimpleNamespace) -> int:
    """Bound the errors of another program's solution; the exit code."""
    vars(options).update(out=None, dry_run=False)
    _targets(options)
    problem = api.load(options.problem)
    if options.certificate:
        state_problem(problem)
    if options.mesh is None and Path(options.solution).suffix in (".csv", ".nc"):
        raise InputError(f"--mesh is missing, because {options.solution} has no triangles")
    option = "--mesh" if options.mesh else "--solution"
    options.mesh = options.mesh or options.solution
    mesh = own_mesh(options.mesh, problem.polygon, option, corners=True)
    from unilateral.exchange.exported_folder import nodal_values_on

    u = nodal_values_on(mesh, options.mesh, options.solution, options.field)
    solution = api.certify(problem, mesh, u)
    printed, _ = _reported(solution, options)
    _keep(solution, options, printed)
    return 0 if printed["h1_bound"] < math.inf else NOT_CONVERGED


def _solved(options: SimpleNamespace, problem: Problem) -> Solution:
    return api.solve(
        problem,
        **{name: getattr(options, name) for name in PASSED_ON},
        mesh=_mesh(options.mesh, problem),
        stop=Stop(**{name: getattr(options, name) for name in OF_STOP}),
        tell=None if options.json else _told(problem, options.by_default),
        begin=options.begin,
    )


def _reported(
    found: Solution, options: SimpleNamespace, interrupted: bool = False
) -> tuple[dict[str, Any], bool]:
    """Prints what was found; its fields, by the names that --json has, and whether there was an interrupt.

    After an interrupt true errors and forces are left out. One while they are computed ends this only where
    no accuracy was asked for.
    """
    search, sharp = found.search, options.sharp
    own_mesh = options.mesh not in (None, *api.KINDS)
    refused = too_large(found.solved, sharp)
    if refused:
        tell(refused)
        bounds = None
    else:
        bounds = found.sharp_bounds if sharp else found.bounds
    if search:
        _tell_faults(search)
        if not options.json:
            say(ending(search, found.problem.units))
    dual = found.partition.n_cells <= FEW
    errors = forces = None
    if not interrupted:
        try:
            errors = found.true_errors(dual)
            forces = _forces(found, sharp) if bounds else None
        except KeyboardInterrupt:
            if search is None:
                raise
            interrupted = True
    printed = record(found, bounds, errors, sharp) | {"forces": forces}
    printed |= {"seconds": time.perf_counter() - options.begin, "peak_mb": peak_mb()}
    doubt = "" if found.unique else not_unique(found.mesh, own_mesh)
    if doubt:
        tell(f"lambda_H {doubt}")
    certified = bool(search) and found.certified
    if bounds and not (sharp or certified) and (flat := flat_triangles(found.solved)):
        tell(flat)
    if not (search or found.converged):
        tell(not_converged(found.solved))
    if reason := lift_dominates(found.solved):
        tell(reason)
    if not options.json and not search:
        say(head(printed))
    if not options.json and found.solved.foreign:
        say(f"  {'u':27} of another program; lambda_H and the contact set are this program's")
    if not options.json and not found.problem.units.reaction:
        say(f"  {WITHOUT_REACTION.format(energy(found.problem.units, 'v'))}")
    elif not (options.json or found.problem.units.trivial):
        say(f"  {NORMS_WITH_COEFFICIENTS}")
    if options.json:
        say(as_json.text(printed))
    else:
        least = {norm: found.solved.size(norm, sharp) if bounds else math.nan for norm in NORMS}
        say(table(printed, bounds, least, doubt, found.problem.units))
        if bounds and not (search or errors or found.solved.foreign) and _too_coarse(found, bounds):
            say(f"  {'hint':27} {TOO_COARSE}{'; it makes its own meshes' * own_mesh}")
    return printed, interrupted


def _too_coarse(solution: Solution, bounds: Bounds) -> bool:
    """Whether the mesh alone may be the reason that the bound is not below the norm of u.

    A u_h that is 0 has no relative error, whatever the mesh.
    """
    return solution.converged and solution.unique and solution.solved.u_norm > 0 and not bounds.relative_u < 1


def _targets(options: SimpleNamespace) -> list[Path]:
    """The files that are asked for; --out's folder is made. Raises InputError for what cannot be written."""
    files = [Path(name) for name in options.output]
    if (files or options.out or options.certificate) and options.dry_run:
        raise InputError(
            "--dry-run computes no solution that could be written; leave out -o, --out and --certificate"
        )
    if options.certificate:
        check_target(options.certificate, CERTIFICATE_ENDINGS)
    for file in files:
        check_target(file, ENDINGS)
    if options.out is None:
        return files
    require("--out needs", *{package for name in KEPT for package in ENDINGS[Path(name).suffix]})
    folder = Path(options.out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise writing_failed(folder, error) from error
    inside = [folder / name for name in KEPT]
    for file in inside:
        check_target(file, ENDINGS)
    return inside + files


def _keep(found: Solution, options: SimpleNamespace, printed: dict[str, Any]) -> None:
    """Writes the files, each told when it is there; .json has what is printed by --json."""
    for file in _targets(options):
        if file.suffix == ".json":
            as_json.write(printed, file)
        else:
            found.save(file)
        if not options.json:
            say(written(file))
    if options.certificate:
        found.save_certificate(options.certificate)
        if not options.json:
            say(written(Path(options.certificate)))
            check = shlex.join(["python3", str(checker_of(found.problem)), options.certificate])
            say(f"  {'check it with':27} {check}")
            if options.sharp:
                bound = interval(-math.inf, found.solved.total("h1"))
                say(f"  {'it proves':27} the bound without --sharp: {bound}")


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


def _mesh(given: str | None, problem: Problem) -> Any:
    """The kind of mesh, or the mesh in a file of that name."""
    if given is None or given in api.KINDS:
        return given or ""
    if not Path(given).is_file():
        raise InputError(f"argument --mesh: '{given}' is neither structured nor unstructured nor a file")
    return own_mesh(given, problem.polygon)


def _told(problem: Problem, by_default: bool) -> Callable[[Level], None]:
    """A function that prints each level, the first one below a line that says what is wanted.

    On a terminal it announces a next level that is expected to take long.
    """
    first, units = True, problem.units

    def one(level: Level) -> None:
        nonlocal first
        if first and by_default:
            say(BY_DEFAULT)
        say(level_head(problem.name, level, units) if first else level_line(level, units.length))
        first = False
        if level.next_seconds >= LONG and sys.stderr.isatty():
            print(next_line(level), file=sys.stderr, flush=True)

    return one


def _tell_faults(search: Search) -> None:
    if search.refusal is not None:
        tell(search.refusal)
    withdrawn = len(search.levels) - len(search.believed)
    if withdrawn:
        tell(f"{counted(withdrawn, 'bound')} {WITHDRAWN}")


def _forces(found: Solution, sharp: bool) -> dict[str, dict[str, float | str | None]] | None:
    """The forces over the boundary and over each side with multipliers, and the reactions on clamped sides.

    None for more than SIDES sides, and where all are free.
    """
    n_sides, cells = found.mesh.polygon.n_sides, found.partition
    if n_sides > SIDES:
        return None
    held = np.unique(cells.side[found.solved.cells])
    forces = found.forces(sharp)
    sides = {f"side_{i}": fields(*forces.sides[i]) for i in held}
    rows = {"_".join(["reaction", *map(str, row)]): fields(*of) for row, of in forces.reactions.items()}
    if forces.total and len(sides) + len(rows) > 1:
        rows["forces_and_reactions"] = fields(*forces.total)
    return ({"boundary": fields(*forces.whole)} | sides if sides else {}) | rows or None
