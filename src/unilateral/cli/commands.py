"""The commands beside `solve` and `certify`: their options, and what they run.

What takes long to import is imported when a command runs, so that help and completion come at once.
"""

from __future__ import annotations

from typing import Any

import click

from unilateral.cli.arguments import (
    FILE_TYPE,
    FOLDER_TYPE,
    complete_polygon,
    complete_problem,
    format_examples,
    json_option,
    parse_count,
    parse_positive,
    parse_sides,
)
from unilateral.cli.guard import print_message, print_result
from unilateral.errors import InputError
from unilateral.system.optional import require

FORMATS = ("text", "json", "python", "ufl")


@click.command(epilog=format_examples("unilateral init my_problem.yaml"))
@click.argument("file", type=FILE_TYPE, help="a new file, such as my_problem.yaml")
def init_command(file: str) -> None:
    """Write a commented problem file to start from."""
    from unilateral.cli import init_check
    from unilateral.system.files import format_file_size

    init_check.write_template(file)
    print_result(f"written: {file}, {format_file_size(file)}; edit it, then type: unilateral check {file}")


@click.command(
    epilog=format_examples(
        "unilateral init my_problem.yaml", "unilateral check my_problem.yaml -o my_problem.svg"
    )
)
@click.argument("file", type=FILE_TYPE, help="a YAML file that declares a problem")
@click.option(
    "-o",
    "--output",
    type=FILE_TYPE,
    metavar="FILE",
    help="a .svg, .png or .pdf file with a drawing of the problem",
)
@click.option("--out", type=FILE_TYPE, hidden=True)  # the former name of -o
def check_command(file: str, output: str | None, out: str | None) -> None:
    """Show how a problem file is read, before anything is solved."""
    from unilateral.cli import init_check
    from unilateral.system.files import format_file_size

    if output is not None and out is not None:
        raise InputError("-o and --out both name the picture; leave out --out")
    picture = out if output is None else output
    print_result(init_check.describe_problem_file(file, picture))
    if picture is not None:
        print_result(f"  written     {picture}, {format_file_size(picture)}")
    if out is not None:
        print_message("--out of check is now called -o; type -o in its place")


@click.command(
    epilog=format_examples(
        "unilateral cases",
        "unilateral cases natural",
        "unilateral cases thirds --polygon lshape --side 1 --format python",
    )
)
@click.argument(
    "name",
    metavar="[CASE]",
    required=False,
    shell_complete=complete_problem,
    help="a case to show, by its name or its YAML file: formulas, contact, regularity, rates",
)
@click.option("--json", "form", flag_value="json", help="print one JSON object, and nothing else")
@click.option(
    "--format",
    "form",
    type=click.Choice(FORMATS),
    default=FORMATS[0],
    help="text (default) or json (like --json); for one case also python (a module for numpy) or ufl",
)
@click.option(
    "--polygon",
    metavar="NAME|FILE",
    shell_complete=complete_polygon,
    help="for one case: this polygon, or that of a problem file (default: all polygons of the case)",
)
@click.option(
    "--side", type=int, metavar="I", help="for one case: the side on which it is placed (default 0)"
)
def cases_command(name: str | None, form: str, polygon: str | None, side: int | None) -> None:
    """List the manufactured cases, or show one with its formulas.

    The formats python and ufl are for one polygon, by default the first that the case is made for.
    """
    if name is None:
        case_options = {
            "--polygon": polygon is not None,
            "--side": side is not None,
            f"--format {form}": form in ("python", "ufl"),
        }
        for option, is_given in case_options.items():
            if is_given:
                raise click.UsageError(f"{option} is for one case; name it, such as natural")
    from unilateral.cli import cases as catalogue
    from unilateral.system.json_records import encode_json

    if name is not None:
        print_result(catalogue.render_case(name, polygon, side or 0, form))
    elif form == "json":
        print_result(encode_json(catalogue.make_catalogue_record()))
    else:
        for line in catalogue.list_cases():
            print_result(line)


@click.command(
    epilog=format_examples(
        "unilateral export natural --h 1/16 --H 1/8 --levels 2 --out natural",
        "unilateral export thirds --polygon lshape --side 4 --h 1/8 --H 1/4 --out thirds",
    )
)
@click.argument(
    "case", shell_complete=complete_problem, help="a case's name, or a YAML file that declares a case"
)
@click.option("--h", type=parse_positive, metavar="EDGE", help="longest boundary edge on the finest level")
@click.option(
    "--H", "H", type=parse_positive, metavar="CELL", required=True, help="longest cell on the finest level"
)
@click.option(
    "--levels",
    type=parse_count,
    metavar="N",
    default=1,
    help="number of levels; each halves h and H (default 1)",
)
@click.option(
    "--mesh", type=FILE_TYPE, metavar="FILE", help="your own mesh as the coarsest level, in place of --h"
)
@click.option(
    "--polygon",
    metavar="NAME|FILE",
    shell_complete=complete_polygon,
    help="a named polygon, or that of a problem file (default: the case's first one)",
)
@click.option(
    "--side", type=int, metavar="I", default=0, help="the side on which the case is placed (default 0)"
)
@click.option(
    "--free-sides",
    type=parse_sides,
    metavar="I,J,...",
    help="sides without contact that become free (Neumann) sides",
)
@click.option(
    "--out",
    type=FOLDER_TYPE,
    metavar="DIR",
    required=True,
    help="a new folder for all files; an existing folder is refused",
)
def export_command(h: float | None, mesh: str | None, **options: Any) -> None:
    """Write a case as files for another solver.

    They are meshes, data and formulas.
    """
    require("'unilateral export' needs", "meshio", "pandas", "xarray")
    if (h is None) == (mesh is None):
        raise click.UsageError("export needs either --h or --mesh")
    from unilateral.cli import exchange

    exchange.run_export(h=h, mesh=mesh, **options)


@click.command(
    epilog=format_examples(
        "unilateral export natural --h 1/8 --H 1/4 --out natural",
        "unilateral solve natural --h 1/8 --H 1/4 -o solution.vtu",
        "unilateral score natural solution.vtu",
    )
)
@click.argument("folder", type=FOLDER_TYPE, metavar="DIR", help="the folder that `unilateral export` wrote")
@click.argument(
    "solutions",
    type=FILE_TYPE,
    metavar="SOLUTION...",
    nargs=-1,
    required=True,
    help="one file for each level",
)
@click.option(
    "--multiplier",
    "multipliers",
    type=FILE_TYPE,
    metavar="FILE",
    multiple=True,
    help="a CSV file with the columns start, end, multiplier; repeat it for each solution",
)
@click.option("--html", type=FILE_TYPE, metavar="FILE", help="also write a page with plots")
@json_option
def score_command(**options: Any) -> int:
    """Judge another solver's solutions of an exported case.

    Printed are errors, rates, and what is wrong.
    """
    require("'unilateral score' needs", "gmsh", "meshio", "pandas", "xarray")
    from unilateral.cli import exchange

    return exchange.run_score(**options)


@click.command(
    epilog=format_examples(
        "unilateral infsup --polygon square --h 1/16 --H 1/8",
        "unilateral export natural --h 1/16 --H 1/8 --out natural",
        "unilateral infsup --mesh natural/level_0/mesh.msh --cells 8",
        "unilateral infsup --mesh natural/level_0/mesh.msh --cells natural/level_0/partition.csv",
    )
)
@click.option("--mesh", type=FILE_TYPE, metavar="FILE", help="your own triangles, in most formats of meshio")
@click.option(
    "--h",
    type=parse_positive,
    metavar="EDGE",
    help="instead of --mesh: the longest boundary edge of the mesh that the command makes",
)
@click.option(
    "--polygon",
    metavar="NAME|FILE",
    shell_complete=complete_polygon,
    help="a named polygon, or that of a problem file; with --mesh the default is the polygon that the "
    "triangles cover",
)
@click.option(
    "--cells",
    type=FILE_TYPE,
    metavar="N|FILE",
    help="N equal cells per side, or a CSV file with the columns start, end",
)
@click.option(
    "--H", "H", type=parse_positive, metavar="CELL", help="instead of --cells: the size of equal cells"
)
@json_option
def infsup_command(**options: Any) -> None:
    """Check whether a mesh and a partition are stable.

    Computed are the constants of Lemma 3.1: beta is the inf-sup constant in H^(-1/2), between bounds up to
    rounding, and beta_0 the one in L2. Both are for -lap u + u. A local rule is checked, too: edges are short
    compared with the cells that they meet, and triangles at the boundary are not flat. Cells and triangles
    that break it are named.
    """
    require("'unilateral infsup' needs", "gmsh")
    for name, alternative in (("mesh", "h"), ("cells", "H")):
        if (options[name] is None) == (options[alternative] is None):
            raise click.UsageError(f"infsup needs either --{name} or --{alternative}")
    from unilateral.cli.infsup import run_infsup

    run_infsup(**options)
