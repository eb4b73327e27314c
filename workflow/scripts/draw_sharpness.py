"""The figure of rates over exponents."""

from job import run

from study.experiments.sharpness.sharpness_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(rates=snakemake.input.rates, fixed=snakemake.input.fixed), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
