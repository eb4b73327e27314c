"""The rates of a scene, judged as the table of expected rates says."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.problems import case
from unilateral.study import tables
from unilateral.study.judge import rates, rates_table


def main(errors, study, judged, name, path):
    table = tables.load(errors)
    judgements = rates.judge_all(
        table, study, {c: case.declared(c)[0]["asymptotic"] for c in table["case"].values}
    )
    ratio = real(study["judged_ratio"], "judged_ratio")
    found = rates_table.collect(judgements, ratio if judged else None)
    tables.save(found, path, name)
    print(rates_table.summary(found, ratio))


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.errors,
        snakemake.params.rates,
        snakemake.params.judged,
        snakemake.wildcards.scene,
        snakemake.output[0],
    )
