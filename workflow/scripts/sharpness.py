"""Errors and rates along h/H, and along H on one mesh."""

from job import run

from study.experiments.sharpness.measure import measure_sharpness

with run(snakemake):
    measure_sharpness(
        study=snakemake.params.study,
        stop=snakemake.params.stop,
        errors=snakemake.output.errors,
        rates=snakemake.output.rates,
        fixed_errors=snakemake.output.fixed_errors,
        fixed_rates=snakemake.output.fixed_rates,
    )
