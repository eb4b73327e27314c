"""The floors that h and H leave in H1."""

from job import run

from study.experiments.scenes.floors import fit_floors

with run(snakemake):
    fit_floors(
        errors=snakemake.input.errors,
        name=snakemake.wildcards.scene,
        ratio=snakemake.params.ratio,
        floors=snakemake.output.floors,
    )
