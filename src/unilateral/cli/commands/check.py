"""The command `unilateral check`."""

from __future__ import annotations

from unilateral.cli.command import argument, command, option
from unilateral.cli.parameters import FILE
from unilateral.cli.streams import load, say


@command(
    "check",
    examples=(
        "unilateral init my_problem.yaml",
        "unilateral check my_problem.yaml --out my_problem.svg",
    ),
    codes=(0, 2, 4, 130, 143),
)
@argument("file", type=FILE, help="a YAML file that declares a problem")
@option("--out", type=FILE, metavar="PICTURE", help="draw it, too: a .svg, .png or .pdf file")
def check(file: str, out: str | None) -> int:
    """Show what is understood of a problem file, before anything is solved."""
    say(load("unilateral.cli.own").check(file, out))
    return 0
