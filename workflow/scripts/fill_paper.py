"""paper.md: its tables."""

import json
from pathlib import Path

import pandas as pd
from sentences import speak_plainly

from unilateral import advice, documents, tables, verdicts
from unilateral.expression import real


def main(claims, rates, scenes, ratio, pairs, infsup, floors, sharpness, norms, factors, study, paper):
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
    crossed, cases, scene, algebra, precision = (tables.load(path) for path in factors)
    H_over_h, coarsest = (
        real(study["base"]["H_over_h"], "H_over_h"),
        real(study["fitted_from"], "fitted_from"),
    )
    blocks |= {
        "advice": advice.advice(crossed, cases, coarsest),
        "targets": advice.targets(crossed, study["targets"]),
        "halving": advice.halving(cases, scene, crossed, coarsest),
        "cost": advice.sentences(crossed, algebra, precision, H_over_h, coarsest),
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
        [snakemake.input[name] for name in ("algorithm", "case", "scene", "algebra", "precision")],
        snakemake.params.cost,
        snakemake.output[0],
    )
