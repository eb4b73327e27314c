"""The commands `solve_command` and `certify_command`: their options, and which of them go together."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import click
from click.core import ParameterSource

from unilateral.adaptive.goal import DEFAULT_ACCURACY, DEFAULT_MAX_SECONDS, GOAL_NORMS
from unilateral.cli import arguments
from unilateral.cli.arguments import (
    FILE_TYPE,
    FOLDER_TYPE,
    complete_polygon,
    parse_count,
    parse_positive,
    parse_sides,
)
from unilateral.solvers.stop import ALGORITHMS, Stop
from unilateral.system.optional import require

ACCURACY_OPTIONS = {"absolute", "dry_run", "norm", "sides", "max_unknowns", "max_seconds", "max_memory"}
"""The options that only an accuracy has."""
MESH_KIND_NAMES = ("structured", "unstructured")
"""The kinds of meshes that are made; any other --mesh is a file."""


@click.command(
    epilog=arguments.format_examples(
        "unilateral init my_problem.yaml",
        "unilateral solve my_problem.yaml",
        "unilateral solve my_problem.yaml --accuracy 0.02 -o my_problem.svg",
        "unilateral solve my_problem.yaml --h 25 --H 50 --json",
    )
)
@arguments.problem_argument
@arguments.json_option
@arguments.output_option
@click.option(
    "--out",
    type=FOLDER_TYPE,
    metavar="FOLDER",
    help="a folder for all useful files, which may exist; for a single file take -o",
)
@arguments.certificate_option
@arguments.sharp_option
@click.option(
    "--h", type=parse_positive, metavar="EDGE", help="longest boundary edge of the mesh, such as 1/64"
)
@click.option(
    "--H", "H", type=parse_positive, metavar="CELL", help="longest cell of the multiplier, such as 1/32"
)
@click.option(
    "--tolerance",
    type=parse_positive,
    metavar="T",
    help="with sizes: stop when the algebraic error is at most T (default: 1 % of the errors)",
)
@click.option(
    "--accuracy",
    type=parse_positive,
    metavar="A",
    help="relative error to reach, such as 1e-2, instead of sizes; the program chooses h, H and the "
    f"tolerance; Ctrl-C keeps the best solution so far (default {DEFAULT_ACCURACY:g} if no sizes are given)",
)
@click.option("--absolute", is_flag=True, help="with --accuracy: the accuracy is the absolute error")
@click.option(
    "--dry-run",
    is_flag=True,
    help="with --accuracy: only estimate the cost: unknowns, seconds, MB and the kind of meshes",
)
@click.option(
    "--norm",
    type=click.Choice(GOAL_NORMS),
    default=GOAL_NORMS[0],
    help="with --accuracy: the error of u in H1 (default), that of lambda in H^(-1/2), or that of a force",
)
@click.option(
    "--sides",
    type=parse_sides,
    metavar="0,2",
    help="with --norm force: the sides of this force, by numbers or names, with the reactions on clamped "
    "sides (default: all sides with contact)",
)
@click.option(
    "--max-unknowns",
    type=parse_count,
    metavar="N",
    help="with --accuracy: limit for the finest mesh (default: as many as the memory allows)",
)
@click.option(
    "--max-seconds",
    type=parse_positive,
    metavar="S",
    help="with --accuracy: time limit; the best solution so far is kept, with its bound "
    f"(default {DEFAULT_MAX_SECONDS:g})",
)
@click.option(
    "--max-memory",
    type=parse_positive,
    metavar="MB",
    help="with --accuracy: memory limit for this process; the best solution so far is kept (default: the "
    "free memory)",
)
@click.option(
    "--polygon",
    metavar="NAME|FILE",
    shell_complete=complete_polygon,
    help="for a case: a named polygon, or that of a problem file (default: the case's first one)",
)
@click.option("--side", type=int, metavar="I", help="for a case: the side on which it is placed (default 0)")
@click.option(
    "--free-sides",
    type=parse_sides,
    metavar="I,J,...",
    help="for a case: sides without contact that become free (Neumann) sides",
)
@click.option(
    "--leave-out-idle-sides",
    is_flag=True,
    help="for a problem: no multipliers on sides that provably have no contact",
)
@click.option(
    "--mesh",
    metavar="KIND|FILE",
    shell_complete=lambda ctx, param, incomplete: arguments.complete_names(incomplete, [*MESH_KIND_NAMES]),
    help="structured (sides along the axes), unstructured (needs gmsh), or a file with triangles, which "
    "--accuracy refines; default: structured on unit squares or without gmsh; with --accuracy refined where "
    "the bound is large",
)
@click.option(
    "--algorithm",
    type=click.Choice(ALGORITHMS),
    metavar="NAME",
    default="auto",
    help=f"{', '.join(ALGORITHMS)} (default auto: multigrid on large meshes, else uzawa)",
)
@click.option(
    "--rho",
    type=parse_positive,
    metavar="STEP",
    help="step of Uzawa's algorithm (default 1.9 / lambda_max(S))",
)
@click.option(
    "--max-steps",
    type=parse_count,
    metavar="N",
    default=Stop.max_steps,
    help=f"limit for uzawa and its faster variants (default {Stop.max_steps})",
)
@click.pass_context
def solve_command(ctx: click.Context, **options: Any) -> int:
    """Solve a problem, with guaranteed bounds on the errors.

    It is solved either to a guaranteed --accuracy, by default of 5 %, or with given sizes --h and --H.
    """
    begin = time.perf_counter()
    given_options = {
        name for name in options if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE
    }
    is_user_mesh = options["mesh"] not in (None, *MESH_KIND_NAMES)
    options["by_default"] = not (
        is_user_mesh or given_options & {"h", "H", "tolerance", "accuracy", "absolute"}
    )
    if options["by_default"]:
        options["accuracy"] = DEFAULT_ACCURACY
    _check_alternatives(ctx, options, given_options, is_user_mesh)
    from unilateral.cli.solve import run_solve

    return run_solve(SimpleNamespace(**options, begin=begin))


def _check_alternatives(
    ctx: click.Context, options: dict[str, Any], given_options: set[str], is_user_mesh: bool
) -> None:
    """Raises UsageError unless the options are those of given sizes, or those of an accuracy."""
    if options["accuracy"] is None:
        if is_user_mesh and "H" not in given_options:
            ctx.fail("a mesh in a file needs --H, the longest cell of the multiplier, or --accuracy")
        missing = [name for name in ("h", "H") if name not in given_options and not is_user_mesh]
        if missing:
            ctx.fail(f"solve needs --h and --H, or --accuracy; --{missing[0]} is missing")
        wrong = given_options & ACCURACY_OPTIONS
        why = "is only for --accuracy"
    else:
        wrong = {"h", "H", "tolerance"} & given_options
        why = "is chosen by --accuracy; leave one of the two out"
    for name in sorted(wrong):
        ctx.fail(f"--{name.replace('_', '-')} {why}")
    if options["sides"] and options["norm"] != "force":
        ctx.fail("--sides is only for --norm force")
    if options["dry_run"] and {"output", "out", "certificate"} & given_options:
        ctx.fail(
            "--dry-run computes no solution that could be written; leave out -o, --out and --certificate"
        )


@click.command(
    epilog=arguments.format_examples(
        "unilateral solve natural --h 1/16 --H 1/8 -o solution.vtu",
        "unilateral certify natural --solution solution.vtu",
    )
)
@arguments.problem_argument
@click.option(
    "--solution", type=FILE_TYPE, metavar="FILE", required=True, help="nodal values: .vtu, .csv with x, y, u"
)
@click.option(
    "--mesh", type=FILE_TYPE, metavar="FILE", help="the triangles (default: those of the solution's file)"
)
@click.option("--field", metavar="NAME", help="the name of the nodal values (default: u, or the only ones)")
@arguments.json_option
@arguments.output_option
@arguments.certificate_option
@arguments.sharp_option
def certify_command(**options: Any) -> int:
    """Bound the errors of another solver's solution of your problem.

    The solution is on a mesh of its own. The bound is not below the error, even if that is the solution of
    another problem.
    """
    begin = time.perf_counter()
    require("'unilateral certify' needs", "meshio", "pandas")
    from unilateral.cli.solve import run_certify

    return run_certify(SimpleNamespace(**options, begin=begin))
