"""The figure of errors of lambda by several methods."""

from job import run

from study.experiments.multipliers.multipliers_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(errors=snakemake.input.errors), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
