"""The tables of the study of cost: all runs, those along each factor, and seconds."""

from job import run

from unilateral.study import tables
from unilateral.study.experiments.cost.measure import along_runs
from unilateral.study.experiments.cost.trade import along
from unilateral.study.experiments.cost.variants import plan


def main(runs, timed, study, axes, cost, timings, factors):
    planned, given = plan(study), {f"cost.{field}": value for field, value in study.items()}
    table = along_runs([tables.load(path) for path in runs], planned)
    tables.save(table, cost, "cost", given)
    tables.save(along_runs([tables.load(path) for path in timed], planned), timings, "cost", given)
    for fields, path in zip(axes, factors, strict=True):
        tables.save(along(table, planned[0], fields), path, "cost", given)


if __name__ == "__main__":
    run(main, snakemake)
