"""Uzawa's algorithm, tried."""

from job import run

from study.experiments.algorithm.tables import try_algorithm

with run(snakemake):
    try_algorithm(
        study=snakemake.params.study,
        steps=snakemake.output.steps,
        certificates=snakemake.output.certificates,
        singular=snakemake.output.singular,
        uniqueness=snakemake.output.uniqueness,
        unique=snakemake.output.unique,
        elimination=snakemake.output.elimination,
        split=snakemake.output.split,
        formulation=snakemake.output.formulation,
    )
