"""The command `unilateral cases`."""

from __future__ import annotations

import click

from unilateral.cli.command import argument, command, option
from unilateral.cli.parameters import CASE, POLYGON, Choice
from unilateral.cli.streams import load, say

FORMATS = ("text", "json", "python", "ufl")


@command(
    "cases",
    examples=(
        "unilateral cases",
        "unilateral cases natural",
        "unilateral cases thirds --polygon lshape --side 1 --format python",
    ),
    codes=(0, 2, 4, 130, 143),
)
@argument(
    "name",
    type=CASE,
    metavar="[CASE]",
    required=False,
    help="show this one, by its name or that of a YAML file: formulas, contact, regularity, rates",
)
@option("--json", "form", flag_value="json", help="print one JSON object, and nothing else")
@option(
    "--format",
    "form",
    type=Choice(FORMATS),
    default=FORMATS[0],
    help="text (default), json as --json; of one case also python, a module for numpy, or ufl",
)
@option(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="of one case: on this polygon or that of a problem file (default: all named ones that it is for)",
)
@option("--side", type=int, metavar="I", help="of one case: the side on which it is put (default 0)")
@click.pass_context
def cases(ctx: click.Context, name: str | None, form: str, polygon: str | None, side: int | None) -> int:
    """List the manufactured cases with their certificates, or show one of them.

    python and ufl are for one polygon, by default the first that the case is for.
    """
    if name:
        say(load("unilateral.cli.one_case").shown(name, polygon, side or 0, form))
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
