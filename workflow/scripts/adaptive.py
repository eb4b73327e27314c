"""Uniform meshes beside adapted ones."""

from job import run

from study.experiments.adaptive.measure import measure_adaptive

with run(snakemake):
    measure_adaptive(
        examples=snakemake.input.examples,
        study=snakemake.params.study,
        stop=snakemake.params.stop,
        errors=snakemake.output.errors,
        infsup=snakemake.output.infsup,
        timings=snakemake.output.timings,
        rates=snakemake.output.rates,
    )
