"""The table behind the figure of all verdicts."""

import json
from pathlib import Path

from sentences import speak_plainly

from unilateral import tables, verdicts


def main(claims, path):
    records = json.loads(Path(claims).read_text(encoding="utf-8"))
    tables.save_csv(verdicts.verdict_frame(records), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.claims, snakemake.output[0])
