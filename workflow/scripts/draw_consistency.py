"""The figure of the consistency term."""

from job import run

from study.experiments.estimates.consistency_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    drawn = table(
        errors=snakemake.input.errors,
        scenes=snakemake.params.scenes,
        case=snakemake.params.case,
        H=snakemake.params.H,
        cases=snakemake.params.cases,
    )
    save_csv(drawn, snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
