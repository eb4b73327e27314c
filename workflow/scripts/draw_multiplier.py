"""The figure of the worst multipliers."""

from job import run

from study.experiments.stability.multiplier_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(survey=snakemake.input.survey, h_over_H=snakemake.params.h_over_H), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
