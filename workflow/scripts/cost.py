"""The tables of the study of cost, one along each axis."""

from job import run

from study.experiments.cost.measure import measure_cost

with run(snakemake):
    measure_cost(
        study=snakemake.params.study,
        scene=snakemake.params.scene,
        norms=snakemake.input.norms,
        axes=snakemake.output.axes,
    )
