"""The errors of u in L2 of a scene."""

from job import run

from study.experiments.scenes.u_in_l2 import measure_u_in_l2

with run(snakemake):
    measure_u_in_l2(
        mesh=snakemake.input.mesh,
        scene=snakemake.params.scene,
        name=snakemake.wildcards.scene,
        stop=snakemake.params.stop,
        ratio=snakemake.params.ratio,
        u_in_l2=snakemake.output.u_in_l2,
    )
