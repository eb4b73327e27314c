"""The command `unilateral solve`: a case or a problem, on given sizes or up to an accuracy."""

from __future__ import annotations

import argparse
import math
import time
from typing import Any

from unilateral.accuracy import LARGEST_BOUNDARY, Goal, Level, levels, natural_kind, standing
from unilateral.bounds.source import enclosed
from unilateral.bounds.total import TotalBound, total_bound
from unilateral.cli.report import NOT_UNIQUE, ending, head, level_head, level_line, table
from unilateral.cli.streams import say, tell
from unilateral.discrete import discretise, solve_to_fraction
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition, polygon
from unilateral.geometry.mesh import Mesh
from unilateral.memory import peak_mb
from unilateral.norms import dual as dual_norm
from unilateral.norms import exact as norms
from unilateral.problems import case as cases
from unilateral.problems import problem_file
from unilateral.problems.case import Case
from unilateral.problems.certificate import certify
from unilateral.problems.problem import Problem
from unilateral.solve import Pair, Stop, guarded_beta, pair, solve
from unilateral.solvers.uzawa import DualResult

NOT_CONVERGED, INTERRUPTED = 3, 130
CHEAP = 20_000
"""Unknowns up to which a case's errors on given sizes are accompanied by their guaranteed bounds."""
Found = dict[str, Any]


def run(options: argparse.Namespace) -> int:
    """Solve and report; the exit code."""
    begin = time.perf_counter()
    problem, free = _problem(options)
    if options.accuracy is not None:
        return _up_to_accuracy(options, problem, free, begin)
    found, result, bound, unique = _on_sizes(options, problem, free)
    _add_cost(found, begin)
    if not unique:
        tell(f"lambda_H {NOT_UNIQUE}")
    if not options.json:
        say(head(found))
    say(table(found, result, bound, options.json, unique))
    return 0 if result.converged else NOT_CONVERGED


def _problem(options: argparse.Namespace) -> tuple[Case | Problem, tuple[int, ...]]:
    """What is to be solved, and its free sides."""
    name = options.problem
    if problem_file.is_declared_in(name):
        for option in ("polygon", "side", "free_sides"):
            if getattr(options, option) is not None:
                raise InputError(f"--{option.replace('_', '-')} is for cases; {name} declares a problem")
        problem = problem_file.load(name)
        return problem, problem.free_sides + (problem.idle_sides() if options.leave_out_idle_sides else ())
    if options.leave_out_idle_sides:
        raise InputError("--leave-out-idle-sides is for problem files; of a case name --free-sides")
    polygons = cases.declared(name)[0]["polygons"]
    domain = polygon.named(options.polygon or ("square" if polygons == "any" else polygons[0]))
    case = cases.load(name, domain, options.side or 0)
    return case, _free_sides(case, options.free_sides or ())


def _free_sides(case: Case, free: tuple[int, ...]) -> tuple[int, ...]:
    """The sides, if lambda is 0 on all of them: then the solution is that with free sides, too."""
    contact = {side for side, _, _ in certify(case).contact}
    n = case.polygon.n_sides
    for side in free:
        if side >= n:
            raise InputError(f"--free-sides: '{case.polygon.name}' has the sides 0 to {n - 1}, not {side}")
        if side in contact:
            raise InputError(f"--free-sides: case '{case.name}' has contact on side {side}")
    if len(free) == n:
        raise InputError("--free-sides: one side at least must not be free")
    return free


def _on_sizes(
    options: argparse.Namespace, problem: Case | Problem, free: tuple[int, ...]
) -> tuple[Found, DualResult, TotalBound | None, bool]:
    """What is printed, the iteration's result, the bound, and whether lambda_H is unique."""
    domain = problem.polygon
    for name, size in (("--h", options.h), ("--H", options.H)):
        if domain.perimeter / size > LARGEST_BOUNDARY * (1 + 1e-9):
            least = f"{domain.perimeter / LARGEST_BOUNDARY:.4g}"
            raise InputError(
                f"{name} {size:.4g} is too fine for '{domain.name}'; it must be at least {least}"
            )
    mesh = getattr(meshes, options.mesh or natural_kind(domain))(domain, options.h)
    cells = partition.uniform(domain, options.H)
    stop = _stop(options)
    if isinstance(problem, Problem):
        solved = solve_to_fraction(discretise(problem, mesh, cells, free), stop)
        found = _found(problem, mesh, solved.discrete.both, solved.result) | {"total_bound": solved.bound.u}
        return found, solved.result, solved.bound, not solved.discrete.both.operator.singular
    condensed = condense(mesh)
    both = pair(condensed, cells, free)
    on_mesh, on_cells = norms.on_mesh(problem, condensed), norms.on_cells(problem, cells)
    beta = guarded_beta(both, norms.first_steklov(condensed))
    solution = solve(on_mesh, on_cells, both, beta, stop)
    found = _found(problem, mesh, both, solution.result) | _errors(on_mesh, both, solution.result)
    bound = None
    if mesh.n_nodes <= CHEAP:
        f, g = enclosed(mesh, problem), problem.enclosed_obstacle
        bound = total_bound(f, g, cells, solution.u_h, solution.lambda_H, free)
        found["total_bound"] = bound.u
    return found, solution.result, bound, not both.operator.singular


def _up_to_accuracy(
    options: argparse.Namespace, problem: Case | Problem, free: tuple[int, ...], begin: float
) -> int:
    goal = Goal(options.accuracy, options.norm or "h1", options.max_unknowns, options.max_seconds or math.inf)
    done: list[Level] = []
    ended = ""
    try:
        for level in levels(problem, goal, free, _stop(options), options.mesh):
            if not options.json:
                say(level_line(level, goal) if done else level_head(problem.name, goal, level))
            done.append(level)
    except (KeyboardInterrupt, InputError) as stopped:
        if not done:
            raise
        ended = "interrupted"
        if isinstance(stopped, InputError):
            ended = "the next level is refused"
            tell(stopped)
    if not (ended or done[-1].certified or done[-1].solved.result.converged):
        ended = "the iteration did not converge (--max-steps, --rho, --algorithm)"
    believed = standing(done)
    if len(believed) < len(done):
        tell(f"bounds withdrawn, for those of finer meshes contradict them: {len(done) - len(believed)}")
    best = min(reversed(believed), key=lambda level: (not level.certified, level.solved.total(goal.norm)))
    solved = best.solved
    found = _found(problem, solved.discrete.mesh, solved.discrete.both, solved.result)
    if isinstance(problem, Case):
        on_mesh = norms.on_mesh(problem, solved.discrete.condensed)
        found |= _errors(on_mesh, solved.discrete.both, solved.result)
    found |= {
        "iterations": sum(level.solved.result.iterations for level in done),
        "converged": best.certified,
        "total_bound": solved.total(goal.norm),
    }
    _add_cost(found, begin)
    if not options.json:
        say(ending(best, done, goal, ended))
    say(table(found, solved.result, solved.bound, options.json))
    return INTERRUPTED if ended == "interrupted" else 0 if best.certified else NOT_CONVERGED


def _stop(options: argparse.Namespace) -> Stop:
    return Stop(
        tolerance=options.tolerance,
        max_steps=options.max_steps,
        algorithm=options.algorithm,
        rho=options.rho,
    )


def _found(problem: Case | Problem, mesh: Mesh, both: Pair, result: DualResult) -> Found:
    """What --json prints, the errors and the cost still unknown."""
    return {
        "problem": problem.name,
        "h": mesh.h,
        "diameter": mesh.diameter,
        "H": both.partition.H,
        "unknowns": mesh.n_nodes,
        "multipliers": len(both.cells),
        "iterations": result.iterations,
        "converged": bool(result.converged),
        "algebraic_bound": result.bound,
        "h1_error": math.nan,
        "hm12_error_lower": math.nan,
        "hm12_error_upper": math.nan,
        "l2_error": math.nan,
        "total_bound": math.nan,
    }


def _errors(on_mesh: norms.OnMesh, both: Pair, result: DualResult) -> Found:
    """The true errors of a case's solution; those of lambda are not judged where beta is 0."""
    difference = on_mesh.flux_load - both.B.T @ result.lambda_H
    found = {"h1_error": on_mesh.h1_error(difference)[0]}
    if not both.operator.singular:
        case, cells, lambda_H = on_mesh.case, both.partition, both.extended(result.lambda_H)
        bounds = dual_norm.dual_norm(cells, [case]).of_error(case, lambda_H[None])
        found["hm12_error_lower"] = max(on_mesh.discrete_dual(difference), float(bounds.lower[0]))
        found["hm12_error_upper"] = float(bounds.upper[0])
        found["l2_error"] = norms.on_cells(case, cells).l2_error(lambda_H)
    return found


def _add_cost(found: Found, begin: float) -> None:
    found["seconds"] = time.perf_counter() - begin
    found["peak_mb"] = peak_mb()
