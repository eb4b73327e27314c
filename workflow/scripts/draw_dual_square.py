"""The figure of the errors in H^(-1/2)."""

from job import run

from study.experiments.estimates.dual_norm_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    drawn = table(
        errors=snakemake.input.errors,
        norm=snakemake.input.norm,
        scene=snakemake.params.scene,
        h_over_H=snakemake.params.h_over_H,
    )
    save_csv(drawn, snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
