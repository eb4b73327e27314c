"""The rates of a scene, judged."""

from job import run

from study.rates import judge_rates

with run(snakemake):
    judge_rates(
        errors=snakemake.input.errors,
        name=snakemake.wildcards.scene,
        study=snakemake.params.study,
        judged=snakemake.params.judged,
        rates=snakemake.output.rates,
    )
