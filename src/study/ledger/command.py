"""The command `unilateral claims`, which the command line finds where the study is installed.

This module imports next to nothing, so that help and completion come at once.
"""

from __future__ import annotations

import sys
from shutil import get_terminal_size
from typing import Any

from unilateral.cli.command import DOES_NOT_HOLD, FOLDER, argument, as_json, command, option
from unilateral.cli.streams import load, say


@command(examples=("unilateral claims", "unilateral claims 4.12"), also=(DOES_NOT_HOLD,))
@argument("claim", metavar="[ID]", required=False, help="judge and explain this one, such as 4.12")
@option(
    "--results",
    type=FOLDER,
    metavar="FOLDER",
    default="results",
    help="where the study wrote them (default results)",
)
@as_json
def claims(claim: str | None, results: str, json: bool) -> int:
    """Show the verdict on each of the paper's statements, or judge one anew by the study's results.

    Both need the folder of results that `make` writes.
    """
    found, text = _one(claim, results) if claim else _all(results)
    say(load("unilateral.system.as_json").text({"claims": found}) if json else text)
    return DOES_NOT_HOLD if any(each["holds"] is False for each in found) else 0


def _all(results: str) -> tuple[list[dict[str, Any]], str]:
    """The stored records of all claims, and the table of them."""
    listing = load("study.ledger.listing")
    found = listing.stored(results)
    width = get_terminal_size().columns if sys.stdout.isatty() else None
    return [_record(each) for each in found], "\n".join(listing.table(found, width))


def _one(claim: str, results: str) -> tuple[list[dict[str, Any]], str]:
    """The record of a claim that is judged now, and everything about it."""
    judge, reports = (load(f"study.ledger.{name}") for name in ("claims", "reports"))
    tables = load("study.ledger.results").finished(results)
    (found,) = judge.judge(tables, [judge.find(claim)])
    return [_record(found.record())], reports.explanation(found)


def _record(stored: dict[str, Any]) -> dict[str, Any]:
    """As stored, with the number that is required without its sign, and whether the claim holds."""
    records, texts = (load(f"study.ledger.{name}") for name in ("records", "texts"))
    measured = not stored["verdict"].startswith(records.UNMEASURED)
    holds = records.holds(stored["verdict"]) if measured else None
    return stored | {"required": texts.required(stored), "holds": holds}
