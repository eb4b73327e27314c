"""The command `unilateral init`."""

from __future__ import annotations

from unilateral.cli.command import argument, command
from unilateral.cli.parameters import FILE
from unilateral.cli.streams import load, say


@command("init", examples=("unilateral init my_problem.yaml",), codes=(0, 2, 4, 130, 143))
@argument("file", type=FILE, help="a new file, such as my_problem.yaml")
def init(file: str) -> int:
    """Write a commented problem file to begin with."""
    load("unilateral.cli.own").init(file)
    say(f"{file} is written; edit it, then: unilateral check {file}")
    return 0
