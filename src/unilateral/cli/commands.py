"""What each command but `solve` takes from the command line, and what it runs.

This module imports next to nothing. What takes long to import is imported when a command runs, by
`streams.load`, so that help and completion come at once.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import click

from unilateral.cli.command import (
    CASE,
    COUNT,
    DOES_NOT_HOLD,
    FILE,
    FOLDER,
    NOT_CONVERGED,
    POLYGON,
    POSITIVE,
    SIDES,
    Choice,
    argument,
    as_json,
    command,
    option,
)
from unilateral.cli.streams import load, say, sized

FORMATS = ("text", "json", "python", "ufl")


@command(examples=("unilateral init my_problem.yaml",))
@argument("file", type=FILE, help="a new file, such as my_problem.yaml")
def init(file: str) -> int:
    """Write a commented problem file to start from."""
    load("unilateral.cli.init_check").init(file)
    say(f"written: {file}, {sized(file)}; edit it, then type: unilateral check {file}")
    return 0


@command(
    examples=("unilateral init my_problem.yaml", "unilateral check my_problem.yaml --out my_problem.svg")
)
@argument("file", type=FILE, help="a YAML file that declares a problem")
@option("--out", type=FILE, metavar="PICTURE", help="a .svg, .png or .pdf file in which it is drawn")
def check(file: str, out: str | None) -> int:
    """Show how a problem file is read, before anything is solved."""
    say(load("unilateral.cli.init_check").check(file, out))
    if out is not None:
        say(f"  written     {out}, {sized(out)}")
    return 0


@command(
    examples=(
        "unilateral cases",
        "unilateral cases natural",
        "unilateral cases thirds --polygon lshape --side 1 --format python",
    ),
)
@argument(
    "name",
    type=CASE,
    metavar="[CASE]",
    required=False,
    help="a case to show, by its name or its YAML file: formulas, contact, regularity, rates",
)
@option("--json", "form", flag_value="json", help="print one JSON object, and nothing else")
@option(
    "--format",
    "form",
    type=Choice(FORMATS),
    default=FORMATS[0],
    help="text (default) or json (like --json); for one case also python (a module for numpy) or ufl",
)
@option(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="for one case: this polygon, or that of a problem file (default: all that it is made for)",
)
@option("--side", type=int, metavar="I", help="for one case: the side on which it is placed (default 0)")
@click.pass_context
def cases(ctx: click.Context, name: str | None, form: str, polygon: str | None, side: int | None) -> int:
    """List the manufactured cases with their certificates, or show one of them.

    The formats python and ufl are for one polygon, by default the first that the case is made for.
    """
    if name:
        say(load("unilateral.cli.cases").shown(name, polygon, side or 0, form))
        return 0
    for option_of_one, given in (("--polygon", polygon), ("--side", side)):
        if given is not None:
            ctx.fail(f"{option_of_one} is for one case; name it, such as natural")
    if form in ("python", "ufl"):
        ctx.fail(f"--format {form} is for one case; name it, such as natural")
    if form == "json":
        say(load("unilateral.system.as_json").text(load("unilateral.cli.cases").records()))
    else:
        for line in load("unilateral.cli.cases").listing():
            say(line)
    return 0


@command(
    examples=(
        "unilateral export natural --h 1/16 --H 1/8 --levels 2 --out natural",
        "unilateral export thirds --polygon lshape --side 4 --h 1/8 --H 1/4 --out thirds",
    ),
)
@argument("case", type=CASE, help="a case's name, or a YAML file that declares a case")
@option("--h", type=POSITIVE, metavar="EDGE", help="longest boundary edge on the finest level")
@option("--H", "H", type=POSITIVE, metavar="CELL", required=True, help="longest cell on the finest level")
@option(
    "--levels", type=COUNT, metavar="N", default=1, help="number of levels; each halves h and H (default 1)"
)
@option("--mesh", type=FILE, metavar="FILE", help="your own mesh as the coarsest level, in place of --h")
@option(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="a named polygon, or that of a problem file (default: the case's first one)",
)
@option("--side", type=int, metavar="I", default=0, help="the side on which the case is placed (default 0)")
@option(
    "--free-sides",
    type=SIDES,
    metavar="I,J,...",
    help="sides without contact that become free (Neumann) sides",
)
@option(
    "--out",
    type=FOLDER,
    metavar="DIR",
    required=True,
    help="a new folder for all files; one that is there is refused",
)
def export(**options: Any) -> int:
    """Write a case as files for another solver: meshes, data and formulas."""
    return int(load("unilateral.cli.exchange").export(**options))


@command(
    examples=(
        "unilateral export natural --h 1/8 --H 1/4 --out natural",
        "unilateral solve natural --h 1/8 --H 1/4 -o solution.vtu",
        "unilateral score natural solution.vtu",
    ),
    also=(DOES_NOT_HOLD,),
)
@argument("folder", type=FOLDER, metavar="DIR", help="the folder that `unilateral export` wrote")
@argument(
    "solutions", type=FILE, metavar="SOLUTION...", nargs=-1, required=True, help="one file for each level"
)
@option(
    "--multiplier",
    "multipliers",
    type=FILE,
    metavar="FILE",
    multiple=True,
    help="a CSV file with the columns start, end, multiplier; repeat it for each solution",
)
@option("--html", type=FILE, metavar="FILE", help="also write a page with plots")
@as_json
def score(**options: Any) -> int:
    """Judge another solver's solutions of an exported case: errors, rates, and what is wrong."""
    return int(load("unilateral.cli.exchange").score(**options))


@command(
    examples=(
        "unilateral solve natural --h 1/16 --H 1/8 -o solution.vtu",
        "unilateral certify natural --solution solution.vtu",
    ),
    also=(NOT_CONVERGED,),
)
@argument("problem", type=CASE, help="the name of a case, or a YAML file that declares a problem or a case")
@option("--solution", type=FILE, metavar="FILE", required=True, help="nodal values: .vtu, .csv with x, y, u")
@option("--mesh", type=FILE, metavar="FILE", help="the triangles (default: those of the solution's file)")
@option("--field", metavar="NAME", help="the nodal values that are meant (default: u, or the only ones)")
@as_json
@option("-o", "--output", type=FILE, metavar="FILE", multiple=True, help="a file, as that of `solve`")
@option("--certificate", type=FILE, metavar="FILE", help="a proof of the bound, as that of `solve`")
@option("--sharp", is_flag=True, help="tighter but slower bounds, especially for lambda")
@click.pass_context
def certify(ctx: click.Context, **options: Any) -> int:
    """Bound the errors of another solver's solution of your problem, on its own mesh."""
    return int(load("unilateral.cli.solve").certify(SimpleNamespace(**options, begin=ctx.obj)))


@command(
    examples=(
        "unilateral infsup --polygon square --h 1/16 --H 1/8",
        "unilateral export natural --h 1/16 --H 1/8 --out natural",
        "unilateral infsup --mesh natural/level_0/mesh.msh --cells 8",
        "unilateral infsup --mesh natural/level_0/mesh.msh --cells natural/level_0/partition.csv",
    ),
)
@option("--mesh", type=FILE, metavar="FILE", help="your own triangles, in most formats of meshio")
@option(
    "--h",
    type=POSITIVE,
    metavar="EDGE",
    help="in place of --mesh: the longest boundary edge of a mesh that is made",
)
@option(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="a named one, or that of a problem file; with --mesh the default is what the triangles cover",
)
@option(
    "--cells",
    type=FILE,
    metavar="N|FILE",
    help="N equal cells per side, or a CSV file with the columns start, end",
)
@option("--H", "H", type=POSITIVE, metavar="CELL", help="in place of --cells: the size of equal cells")
@as_json
@click.pass_context
def infsup(ctx: click.Context, **options: Any) -> int:
    """Check whether a mesh and a partition of its boundary are stable: the constants of Lemma 3.1.

    beta is the inf-sup constant in H^(-1/2), between bounds up to rounding, and beta_0 the one in L2. Both
    are for -lap u + u. A local rule is checked, too: edges are short compared with the cells that they meet,
    and triangles at the boundary are not flat. Cells and triangles that break it are named.
    """
    for one, other in (("mesh", "h"), ("cells", "H")):
        if (options[one] is None) == (options[other] is None):
            ctx.fail(f"infsup needs either --{one} or --{other}")
    return int(load("unilateral.cli.infsup").run(**options))
