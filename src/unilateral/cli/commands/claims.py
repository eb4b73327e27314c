"""The command `unilateral claims`."""

from __future__ import annotations

from typing import Any

from unilateral.cli.command import argument, command, option
from unilateral.cli.parameters import FOLDER, as_json
from unilateral.cli.streams import load, say

CLAIM_FAILS = 1


@command(
    "claims", examples=("unilateral claims", "unilateral claims 4.12"), codes=(0, CLAIM_FAILS, 2, 4, 130, 143)
)
@argument("claim", metavar="[ID]", required=False, help="explain this one, such as 4.12")
@option("--results", type=FOLDER, metavar="FOLDER", default="results", help="default results")
@as_json
def claims(claim: str | None, results: str, json: bool) -> int:
    """Judge the paper's statements by the study's results, in the folder that `make` writes."""
    judge, printed = (load(f"unilateral.study.ledger.{name}") for name in ("claims", "printed"))
    tables = load("unilateral.study.ledger.results").finished(results)
    found = judge.judge(tables, [judge.find(claim)] if claim else None)
    if json:
        say(load("unilateral.system.as_json").text({"claims": [_record(each) for each in found]}))
    else:
        say(printed.explanation(found[0]) if claim else printed.summary(found))
    return CLAIM_FAILS if any(each.counts_against for each in found) else 0


def _record(judgement: Any) -> dict[str, Any]:
    """As stored, and whether it holds; the number that was required without its sign."""
    required = getattr(judgement.evidence, "required", None)  # there is none where a claim is not judged
    holds = None if judgement.evidence is None else judgement.holds
    return judgement.record() | {"required": required, "holds": holds}
