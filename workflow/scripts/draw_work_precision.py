"""The figure of errors over work."""

from job import run

from study.experiments.cost.work_precision_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    drawn = table(
        crossed=snakemake.input.crossed,
        cases=snakemake.input.cases,
        algebra=snakemake.input.algebra,
        base=snakemake.params.base,
        coarsest=snakemake.params.coarsest,
    )
    save_csv(drawn, snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
