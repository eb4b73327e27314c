"""The command `unilateral export`."""

from __future__ import annotations

from typing import Any

from unilateral.cli.command import argument, command, option
from unilateral.cli.parameters import CASE, COUNT, FILE, FOLDER, POLYGON, POSITIVE, SIDES
from unilateral.cli.streams import load


@command(
    "export",
    examples=(
        "unilateral export natural --h 1/16 --H 1/8 --levels 2 --out natural",
        "unilateral export thirds --polygon lshape --side 4 --h 1/8 --H 1/4 --out thirds",
    ),
    codes=(0, 2, 4, 130, 143),
)
@argument("case", type=CASE, help="a case's name, or a YAML file that declares a case")
@option("--h", type=POSITIVE, metavar="EDGE", help="mesh size on the boundary, on the finest level")
@option(
    "--H", "H", type=POSITIVE, metavar="CELL", required=True, help="size of the cells, on the finest level"
)
@option("--levels", type=COUNT, metavar="N", default=1, help="each halves h and H (default 1)")
@option("--mesh", type=FILE, metavar="FILE", help="of your own, the coarsest level, in place of --h")
@option(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="a named one, or that of a problem file (default: the first it is for)",
)
@option("--side", type=int, metavar="I", default=0, help="on which the case is put (default 0)")
@option("--free-sides", type=SIDES, metavar="I,J,...", help="sides without contact, as free ones")
@option("--out", type=FOLDER, metavar="DIR", required=True, help="a folder that is not there yet")
def export(**options: Any) -> int:
    """Write a case as files for another solver: meshes, data and formulas."""
    return int(load("unilateral.cli.exchange").export(**options))
