"""The forms of the dual norm of a scene."""

from job import run

from study.experiments.estimates.forms import measure_dual_norm

with run(snakemake):
    measure_dual_norm(
        scene=snakemake.params.scene,
        name=snakemake.wildcards.scene,
        dual_norm=snakemake.output.dual_norm,
    )
