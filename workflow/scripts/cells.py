"""Infinitely many transitions, and contact and a gap in each cell."""

from job import run

from study.experiments.cells.measure import measure_cells

with run(snakemake):
    measure_cells(
        study=snakemake.params.study,
        stop=snakemake.params.stop,
        errors=snakemake.output.errors,
        alternating=snakemake.output.alternating,
    )
