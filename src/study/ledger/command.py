"""The command `unilateral claims`, which the command line has where the study is installed.

What takes long to import is imported when the command runs, so that help and completion come at once.
"""

from __future__ import annotations

import sys
from shutil import get_terminal_size
from typing import Any

import click

from unilateral.cli.arguments import FOLDER_TYPE, format_examples, json_option
from unilateral.cli.guard import EXIT_REJECTED, print_result


@click.command(epilog=format_examples("unilateral claims", "unilateral claims 4.12"))
@click.argument("claim", metavar="[ID]", required=False, help="judge and explain this one, such as 4.12")
@click.option(
    "--results",
    type=FOLDER_TYPE,
    metavar="FOLDER",
    default="results",
    help="where the study wrote them (default results)",
)
@json_option
def claims(claim: str | None, results: str, json: bool) -> int:
    """Show the verdict on each of the paper's statements.

    With an ID that claim is judged anew. Both need the folder of results that `make` writes.
    """
    from study.ledger import listing
    from unilateral.system.json_records import encode_json as as_text

    if claim:
        from study.ledger import claims as judge
        from study.ledger.results import open_finished_results

        (judged,) = judge.judge_all(open_finished_results(results), [judge.find_claim(claim)])
        claim_records = [_complete_record(judged.record())]
        text = listing.explain_claim(judged)
    else:
        stored = listing.read_claim_records(results)
        width = get_terminal_size().columns if sys.stdout.isatty() else None
        claim_records = [_complete_record(record) for record in stored]
        text = "\n".join(listing.list_claims(stored, width))
    print_result(as_text({"claims": claim_records}) if json else text)
    return EXIT_REJECTED if any(record["holds"] is False for record in claim_records) else 0


def _complete_record(stored: dict[str, Any]) -> dict[str, Any]:
    """A stored record with the number that is required and whether the claim holds."""
    from study.ledger import records, texts

    measured = not stored["verdict"].startswith(records.UNMEASURED)
    holds = records.verdict_holds(stored["verdict"]) if measured else None
    return stored | {"required": texts.required_number(stored), "holds": holds}
