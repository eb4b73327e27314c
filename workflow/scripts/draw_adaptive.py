"""The figure of errors and bounds on adapted meshes."""

from job import run

from study.experiments.adaptive.adaptive_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(errors=snakemake.input.errors, infsup=snakemake.input.infsup), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
