"""The figure of all verdicts."""

from job import run

from study.ledger.verdict_figure import draw, table
from study.tables import save_csv

with run(snakemake):
    save_csv(table(claims=snakemake.input.claims), snakemake.output.csv)
    draw(snakemake.output.csv, snakemake.output.svg)
