"""What `unilateral solve` takes from the command line; it imports next to nothing, as `commands`."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any

import click
from click.core import ParameterSource

from unilateral.accuracy.goal import ACCURACY, MAX_SECONDS, NORMS
from unilateral.cli.command import (
    CASE,
    COUNT,
    FILE,
    FOLDER,
    NOT_CONVERGED,
    POLYGON,
    POSITIVE,
    SIDES,
    Choice,
    Name,
    argument,
    as_json,
    command,
    option,
)
from unilateral.cli.streams import load
from unilateral.solvers.stop import ALGORITHMS, Stop

OF_ACCURACY = {"absolute", "dry_run", "norm", "max_unknowns", "max_seconds", "max_memory"}
KINDS = ("structured", "unstructured")
sizes, goal, domain, method = (
    partial(option, heading=heading)
    for heading in ("With given sizes", "To an accuracy", "Domain and multipliers", "Iteration")
)


@command(
    examples=(
        "unilateral init my_problem.yaml",
        "unilateral solve my_problem.yaml --h 1/16 --H 1/8",
        "unilateral solve my_problem.yaml --accuracy 0.1 --json",
    ),
    also=(NOT_CONVERGED,),
)
@argument("problem", type=CASE, help="the name of a case, or a YAML file that declares a problem or a case")
@as_json
@option(
    "-o",
    "--output",
    type=FILE,
    metavar="FILE",
    multiple=True,
    help="keep the solution: .vtu, .csv, .nc, .json, .svg, .png, .pdf or .html; may be repeated",
)
@option(
    "--out", type=FOLDER, metavar="FOLDER", help="a folder for all useful files; for a single file take -o"
)
@option(
    "--certificate",
    type=FILE,
    metavar="FILE",
    help="a file, .json or .json.gz, from which a short separate program proves the bound",
)
@option("--sharp", is_flag=True, help="tighter but slower bounds, especially for lambda")
@sizes("--h", type=POSITIVE, metavar="EDGE", help="longest boundary edge of the mesh, such as 1/64")
@sizes("--H", "H", type=POSITIVE, metavar="CELL", help="longest cell of the multiplier, such as 1/32")
@sizes(
    "--tolerance",
    type=POSITIVE,
    metavar="T",
    help="stop when the algebraic error is at most T (default: 1 % of the errors)",
)
@goal(
    "--accuracy",
    type=POSITIVE,
    metavar="A",
    help="relative error to reach, such as 1e-2; h, H and the stop are chosen; Ctrl-C keeps the best so far "
    f"(default {ACCURACY:g}, where no sizes are given)",
)
@goal(
    "--absolute",
    is_flag=True,
    help="absolute instead of relative error",
)
@goal(
    "--dry-run",
    is_flag=True,
    help="only estimate what it would take: unknowns, seconds, MB and the kind of meshes",
)
@goal(
    "--norm",
    type=Choice(NORMS),
    default=NORMS[0],
    help="the error of u in H1 (default), or that of lambda in H^(-1/2)",
)
@goal(
    "--max-unknowns",
    type=COUNT,
    metavar="N",
    help="limit for the finest mesh (default: what the memory allows)",
)
@goal(
    "--max-seconds",
    type=POSITIVE,
    metavar="S",
    help=f"time limit; the best so far is kept, with its bound (default {MAX_SECONDS:g})",
)
@goal(
    "--max-memory",
    type=POSITIVE,
    metavar="MB",
    help="memory limit for this process; the best so far is kept (default: what is free)",
)
@domain(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="for a case: a named polygon, or that of a problem file (default: the case's first one)",
)
@domain("--side", type=int, metavar="I", help="for a case: the side on which it is placed (default 0)")
@domain(
    "--free-sides",
    type=SIDES,
    metavar="I,J,...",
    help="for a case: sides without contact that become free (Neumann) sides",
)
@domain(
    "--leave-out-idle-sides",
    is_flag=True,
    help="for a problem: no multipliers on sides that provably have no contact",
)
@domain(
    "--mesh",
    type=Name(lambda: KINDS),
    metavar="KIND|FILE",
    help="structured (sides along the axes), unstructured (needs gmsh), or a file with triangles; "
    "default: structured on unit squares or without gmsh, and with --accuracy refined where it pays",
)
@method(
    "--algorithm",
    type=Choice(ALGORITHMS),
    metavar="NAME",
    default="auto",
    help=f"{', '.join(ALGORITHMS)} (default auto: multigrid on large meshes, else uzawa)",
)
@method(
    "--rho", type=POSITIVE, metavar="STEP", help="step of Uzawa's algorithm (default 1.9 / lambda_max(S))"
)
@method(
    "--max-steps",
    type=COUNT,
    metavar="N",
    default=Stop.max_steps,
    help=f"limit for uzawa and its faster variants (default {Stop.max_steps})",
)
@click.pass_context
def solve(ctx: click.Context, **options: Any) -> int:
    """Solve a problem, either with given sizes --h and --H or to a guaranteed --accuracy."""
    given = {name for name in options if ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE}
    own_mesh = options["mesh"] not in (None, *KINDS)
    options["by_default"] = not (own_mesh or given & {"h", "H", "tolerance", "accuracy", "absolute"})
    if options["by_default"]:
        options["accuracy"] = ACCURACY
    _check_alternatives(ctx, options, given, own_mesh)
    return int(load("unilateral.cli.solve").run(SimpleNamespace(**options, begin=ctx.obj)))


def _check_alternatives(ctx: click.Context, options: dict[str, Any], given: set[str], own_mesh: bool) -> None:
    """Raises UsageError unless the options are those of given sizes, or those of an accuracy."""
    if own_mesh and options["accuracy"] is not None:
        ctx.fail("--accuracy makes its own meshes; with a mesh in a file give --H instead")
    if options["accuracy"] is None:
        if own_mesh and "H" not in given:
            ctx.fail("a mesh in a file needs --H, the longest cell of the multiplier")
        missing = [name for name in ("h", "H") if name not in given and not own_mesh]
        if missing:
            ctx.fail(f"solve needs --h and --H, or --accuracy; --{missing[0]} is missing")
        wrong, why = given & OF_ACCURACY, "is only for --accuracy"
    else:
        if options["accuracy"] >= 1 and not options["absolute"]:
            ctx.fail(
                "argument --accuracy: it is relative and must be below 1, such as 1e-2; or add --absolute"
            )
        wrong, why = {"h", "H", "tolerance"} & given, "is chosen by --accuracy; leave one of the two out"
    for name in sorted(wrong):
        ctx.fail(f"--{name.replace('_', '-')} {why}")
