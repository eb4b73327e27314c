"""The manifest of all results, and their checksums."""

from job import run

from study.manifest import write_manifest

with run(snakemake):
    write_manifest(
        study=snakemake.params.study,
        made=dict(snakemake.input.items()),
        manifest=snakemake.output.manifest,
        sums=snakemake.output.sums,
    )
