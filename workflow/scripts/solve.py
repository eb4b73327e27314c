"""All cases of a scene on all levels."""

from job import run

from study.experiments.scenes.measure import solve_scene

with run(snakemake):
    solve_scene(
        norm=snakemake.input.norm,
        scene=snakemake.params.scene,
        name=snakemake.wildcards.scene,
        stop=snakemake.params.stop,
        mesh=snakemake.output.mesh,
        solutions=snakemake.output.solutions,
        errors=snakemake.output.errors,
        infsup=snakemake.output.infsup,
        timings=snakemake.output.timings,
    )
