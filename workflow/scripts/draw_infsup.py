"""The figure of beta."""

from job import run

from study.experiments.stability.infsup_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    drawn = table(
        surveys=snakemake.input.surveys,
        families=snakemake.params.families,
    )
    save_csv(drawn, snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
