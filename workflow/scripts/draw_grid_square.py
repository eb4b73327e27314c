"""The figure of errors over the (h, H) plane."""

from job import run

from study.experiments.scenes.grid_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(errors=snakemake.input.errors, cases=snakemake.params.cases), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
