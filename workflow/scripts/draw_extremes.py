"""The figure of where algorithms fail."""

from job import run

from study.experiments.extremes.extremes_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(extremes=snakemake.input.extremes), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
