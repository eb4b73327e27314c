"""The command `unilateral claims`, which the command line has where the study is installed.

What takes long to import is imported when the command runs, so that help and completion come at once.
"""

from __future__ import annotations

import sys
from shutil import get_terminal_size
from typing import Any

import click

from unilateral.cli.arguments import FOLDER, as_json, examples
from unilateral.cli.guard import DOES_NOT_HOLD, say


@click.command(epilog=examples("unilateral claims", "unilateral claims 4.12"))
@click.argument("claim", metavar="[ID]", required=False, help="judge and explain this one, such as 4.12")
@click.option(
    "--results",
    type=FOLDER,
    metavar="FOLDER",
    default="results",
    help="where the study wrote them (default results)",
)
@as_json
def claims(claim: str | None, results: str, json: bool) -> int:
    """Show the verdict on each of the paper's statements.

    With an ID that claim is judged anew. Both need the folder of results that `make` writes.
    """
    from study.ledger import listing
    from unilateral.system.as_json import text as as_text

    if claim:
        from study.ledger import claims as judge
        from study.ledger.results import finished

        (judged,) = judge.judge(finished(results), [judge.find(claim)])
        found = [_record(judged.record())]
        text = listing.explanation(judged)
    else:
        stored = listing.stored(results)
        width = get_terminal_size().columns if sys.stdout.isatty() else None
        found = [_record(each) for each in stored]
        text = "\n".join(listing.table(stored, width))
    say(as_text({"claims": found}) if json else text)
    return DOES_NOT_HOLD if any(each["holds"] is False for each in found) else 0


def _record(stored: dict[str, Any]) -> dict[str, Any]:
    """As stored, with the number that is required without its sign, and whether the claim holds."""
    from study.ledger import records, texts

    measured = not stored["verdict"].startswith(records.UNMEASURED)
    holds = records.holds(stored["verdict"]) if measured else None
    return stored | {"required": texts.required(stored), "holds": holds}
