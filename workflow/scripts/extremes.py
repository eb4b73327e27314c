"""Where algorithms fail."""

from job import run

from study.experiments.extremes.measure import try_extremes

with run(snakemake):
    try_extremes(
        study=snakemake.params.study,
        extremes=snakemake.output.extremes,
    )
