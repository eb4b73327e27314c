"""All levels of the scene `deep`: errors, rates, and what the levels took beside what was predicted."""

import xarray as xr
from job import run

from unilateral.formulas.formula import real
from unilateral.problems import case
from unilateral.study import rates_table, tables
from unilateral.study.experiments.deep import measure as deep
from unilateral.study.rates import judge_all


def main(levels, timed, study, predicted, errors, rates, timings):
    table, given = deep.diagonal(map(tables.load, levels)), {"rates": study}
    tables.save(table, errors, "deep", given)
    asymptotic = {name: case.declared(name)[0]["asymptotic"] for name in table["case"].values}
    ratio = real(study["judged_ratio"], "judged_ratio")
    found = rates_table.collect(judge_all(tables.load(errors), study, asymptotic), ratio)
    tables.save(found, rates, "deep", given)
    taken = xr.concat(map(tables.load, timed), "mesh")
    taken = taken.assign({f"predicted_{unit}": ("mesh", values) for unit, values in predicted.items()})
    tables.save(taken, timings, "deep", given)
    print(rates_table.summary(found, ratio), taken.to_dataframe().to_string(index=False), sep="\n\n")


if __name__ == "__main__":
    run(main, snakemake)
