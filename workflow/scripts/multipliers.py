"""Errors of lambda by other methods on the same meshes."""

from job import run

from study.experiments.multipliers.measure import measure_multipliers

with run(snakemake):
    measure_multipliers(
        study=snakemake.params.study,
        errors=snakemake.output.errors,
    )
