"""The command `unilateral score`."""

from __future__ import annotations

from typing import Any

from unilateral.cli.command import argument, command, option
from unilateral.cli.parameters import FILE, FOLDER, as_json
from unilateral.cli.streams import load


@command(
    "score",
    examples=(
        "unilateral export natural --h 1/8 --H 1/4 --out natural",
        "unilateral solve natural --h 1/8 --H 1/4 -o solution.vtu",
        "unilateral score natural solution.vtu",
    ),
    codes=(0, 1, 2, 4, 130, 143),
)
@argument("folder", type=FOLDER, metavar="DIR", help="what `unilateral export` wrote")
@argument(
    "solutions", type=FILE, metavar="SOLUTION...", nargs=-1, required=True, help="a file for each level"
)
@option(
    "--multiplier",
    "multipliers",
    type=FILE,
    metavar="FILE",
    multiple=True,
    help="a CSV file of start, end, multiplier; once for each solution",
)
@option("--html", type=FILE, metavar="FILE", help="write a page with plots, too")
@as_json
def score(**options: Any) -> int:
    """Judge another solver's solutions of an exported case: errors, rates, and what is wrong."""
    return int(load("unilateral.cli.exchange").score(**options))
