"""The ledger judged by the study's tables."""

import json

from sentences import speak_plainly

from unilateral.files import replacing
from unilateral.study.judge import claims


def main(results, path):
    found = claims.judge(claims.Results(results))
    with replacing(path) as temporary:
        temporary.write_text(json.dumps([each.record() for each in found], indent=1) + "\n", encoding="utf-8")
    print(claims.summary(found))


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.results, snakemake.output[0])
