"""Meshes graded to a vertex, and those that the bound refines."""

from job import run

from study.experiments.graded.measure import measure_grading

with run(snakemake):
    measure_grading(
        study=snakemake.params.study,
        stop=snakemake.params.stop,
        errors=snakemake.output.errors,
        adapted=snakemake.output.adapted,
    )
