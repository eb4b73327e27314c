"""The ledger judged by the study's tables, which lie in folders beside it."""

import json
from pathlib import Path

from job import run

from unilateral.study.ledger.claims import judge
from unilateral.study.ledger.printed import summary
from unilateral.study.ledger.results import Results
from unilateral.system.files import replacing


def main(tables, claims):
    found = judge(Results(Path(claims).parent))
    with replacing(claims) as temporary:
        temporary.write_text(json.dumps([each.record() for each in found], indent=1) + "\n", encoding="utf-8")
    print(summary(found))


if __name__ == "__main__":
    run(main, snakemake)
