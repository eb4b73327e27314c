"""README.md: its tables of rates, of beta and of cost."""

import pandas as pd
from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.text import advice, documents


def main(paths, scenes, ratio, pairs, uniform_ratios, rule, crossed, cases, cost, readme):
    found = {name: tables.load(path) for name, path in zip(scenes, paths, strict=True)}
    beta = pd.read_csv(pairs)
    blocks = {
        "rates": documents.rates_table(found, real(ratio, "judged_ratio")),
        "beta": documents.infsup_table(beta, [real(each, "uniform_ratios") for each in uniform_ratios]),
        "rule": documents.infsup_rule(beta, **rule),
        "advice": advice.advice(
            tables.load(crossed),
            tables.load(cases),
            real(cost["base"]["H_over_h"], "H_over_h"),
            real(cost["fitted_from"], "fitted_from"),
        ),
    }
    documents.fill(readme, blocks)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.rates,
        snakemake.params.scenes,
        snakemake.params.judged_ratio,
        snakemake.input.pairs,
        snakemake.params.infsup["uniform_ratios"],
        snakemake.params.infsup["rule"],
        snakemake.input.crossed,
        snakemake.input.cases,
        snakemake.params.cost,
        snakemake.output[0],
    )
