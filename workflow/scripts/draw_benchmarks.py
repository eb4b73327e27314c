"""The figure of other solvers side by side."""

from job import run

from benchmarks.benchmarks_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(results=snakemake.input.results), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
