"""The command `unilateral infsup`."""

from __future__ import annotations

from typing import Any

import click

from unilateral.cli.command import command, option
from unilateral.cli.parameters import FILE, POLYGON, POSITIVE, as_json
from unilateral.cli.streams import load


@command(
    "infsup",
    examples=(
        "unilateral infsup --polygon square --h 1/16 --H 1/8",
        "unilateral export natural --h 1/16 --H 1/8 --out natural",
        "unilateral infsup --mesh natural/level_0/mesh.msh --cells 8",
        "unilateral infsup --mesh natural/level_0/mesh.msh --cells natural/level_0/partition.csv",
    ),
    codes=(0, 2, 4, 130, 143),
)
@option("--mesh", type=FILE, metavar="FILE", help="triangles of your own, in a format of meshio")
@option("--h", type=POSITIVE, metavar="EDGE", help="in place of --mesh: size of a mesh that is made")
@option(
    "--polygon",
    type=POLYGON,
    metavar="NAME|FILE",
    help="a named one, or that of a problem file; with --mesh by default what the triangles cover",
)
@option("--cells", type=FILE, metavar="N|FILE", help="N equal cells a side, or a CSV file of start, end")
@option("--H", "H", type=POSITIVE, metavar="CELL", help="in place of --cells: the size of equal cells")
@as_json
@click.pass_context
def infsup(ctx: click.Context, **options: Any) -> int:
    """Tell whether a mesh and a partition of its boundary are stable: the constants of Lemma 3.1.

    beta is the inf-sup constant in H^(-1/2), between guaranteed bounds, beta_0 the one in L2, for -lap u + u.
    Beside them stands the local rule: edges are short against the cells that they meet, and triangles at the
    boundary are not flat. Cells and triangles that break it are named.
    """
    for one, other in (("mesh", "h"), ("cells", "H")):
        if (options[one] is None) == (options[other] is None):
            ctx.fail(f"infsup needs either --{one} or --{other}")
    return int(load("unilateral.cli.infsup").run(**options))
