"""The figure of one solution."""

from job import run

from study.experiments.portrait.portrait_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    drawn = table(
        polygon=snakemake.params.polygon,
        f=snakemake.params.f,
        h=snakemake.params.h,
        H=snakemake.params.H,
        reference=snakemake.params.reference,
    )
    save_csv(drawn, snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
