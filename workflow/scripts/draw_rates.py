"""The figure of a scene's errors over h."""

from job import run

from study.experiments.scenes.rates_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(errors=snakemake.input.errors, rates=snakemake.input.rates), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
