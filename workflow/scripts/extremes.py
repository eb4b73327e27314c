"""Where algorithms fail, how sharp bounds are over c/k, and the work at neighbouring sizes."""

from job import run

from study.experiments.extremes.measure import try_extremes

with run(snakemake):
    try_extremes(
        study=snakemake.params.study,
        extremes=snakemake.output.extremes,
        reaction=snakemake.output.reaction,
        neighbours=snakemake.output.neighbours,
    )
