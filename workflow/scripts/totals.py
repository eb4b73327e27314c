"""The guaranteed total errors of a scene."""

from job import run

from study.experiments.scenes.totals import bound_totals

with run(snakemake):
    bound_totals(
        mesh=snakemake.input.mesh,
        solutions=snakemake.input.solutions,
        scene=snakemake.params.scene,
        name=snakemake.wildcards.scene,
        levels=snakemake.params.levels,
        case_names=snakemake.params.case_names,
        ratio=snakemake.params.ratio,
        totals=snakemake.output.totals,
    )
