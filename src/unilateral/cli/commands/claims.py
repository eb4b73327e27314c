"""The command `unilateral claims`."""

from __future__ import annotations

from unilateral.cli.command import argument, command, option
from unilateral.cli.parameters import FOLDER
from unilateral.cli.streams import load, say

CLAIM_FAILS = 1


@command(
    "claims", examples=("unilateral claims", "unilateral claims 4.12"), codes=(0, CLAIM_FAILS, 2, 4, 130)
)
@argument("claim", metavar="[ID]", required=False, help="explain this one, such as 4.12")
@option("--results", type=FOLDER, metavar="FOLDER", default="results", help="default results")
def claims(claim: str | None, results: str) -> int:
    """Judge the paper's statements by the study's results, in the folder that `make` writes."""
    judged = load("unilateral.study.judge.claims")
    tables = judged.Results(results)
    if claim is None:
        found = judged.judge(tables)
        say(judged.summary(found))
    else:
        found = judged.judge(tables, [judged.find(claim)])
        say(judged.explanation(found[0]))
    return 0 if all(each.holds for each in found) else CLAIM_FAILS
