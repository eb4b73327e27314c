"""Errors of other methods' solutions, and guaranteed bounds on them."""

from job import run

from study.experiments.certify.measure import measure_certify

with run(snakemake):
    measure_certify(
        study=snakemake.params.study,
        solutions=snakemake.output.solutions,
    )
