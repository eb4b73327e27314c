"""The figure of the bounds over c/k."""

from job import run

from study.experiments.extremes.reaction_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(reaction=snakemake.input.reaction), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
