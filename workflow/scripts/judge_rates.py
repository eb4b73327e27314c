"""The rates of a scene, judged as the table of expected rates says."""

from job import run

from unilateral.formulas.formula import real
from unilateral.problems import case
from unilateral.study import rates_table, tables
from unilateral.study.rates import judge_all


def main(errors, name, study, judged, rates):
    table = tables.load(errors)
    asymptotic = {c: case.declared(c)[0]["asymptotic"] for c in table["case"].values}
    ratio = real(study["judged_ratio"], "judged_ratio")
    found = rates_table.collect(judge_all(table, study, asymptotic), ratio if judged else None)
    tables.save(found, rates, name, {"rates": study, f"scenes.{name}.judged": judged})
    print(rates_table.summary(found, ratio))


if __name__ == "__main__":
    run(main, snakemake)
