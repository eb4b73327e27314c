"""paper.md: its tables."""

import json
from pathlib import Path

import pandas as pd
from sentences import speak_plainly

from unilateral import documents, tables, verdicts
from unilateral.expression import real


def main(claims, rates, scenes, ratio, pairs, infsup, floors, sharpness, norms, paper):
    found = {name: tables.load(path) for name, path in zip(scenes, rates, strict=True)}
    beta = pd.read_csv(pairs)
    ratios = [real(each, "uniform_ratios") for each in infsup["uniform_ratios"]]
    blocks = verdicts.claims_tables(json.loads(Path(claims).read_text(encoding="utf-8")))
    blocks |= {
        "rates": documents.rates_table(found, real(ratio, "judged_ratio")),
        "beta": documents.infsup_table(beta, ratios),
        "rule": documents.infsup_rule(beta, **infsup["rule"]),
        "floors": documents.floors_table(tables.load(floors)),
        "exceptions": documents.exceptions(
            tables.load(sharpness), {name: norms[name]["tolerance"] for name in ("hm12", "l2")}
        ),
    }
    documents.fill(paper, blocks)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.claims,
        snakemake.input.rates,
        snakemake.params.scenes,
        snakemake.params.judged_ratio,
        snakemake.input.pairs,
        snakemake.params.infsup,
        snakemake.input.floors,
        snakemake.input.sharpness,
        snakemake.params.norms,
        snakemake.output[0],
    )
