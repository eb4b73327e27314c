"""The command `unilateral cases`."""

from __future__ import annotations

from unilateral.cli.command import command
from unilateral.cli.streams import load, say


@command("cases", examples=("unilateral cases",), codes=(0, 2, 4, 130))
def cases() -> int:
    """List the manufactured cases with their certificates."""
    for line in load("unilateral.cli.cases").listing():
        say(line)
    return 0
