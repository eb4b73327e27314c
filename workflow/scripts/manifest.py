"""The manifest of all results, and their checksums."""

from job import run

from study.manifest import write_manifest

with run(snakemake):
    write_manifest(
        study=snakemake.params.study,
        files_by_rule=dict(snakemake.input.items()),
        manifest=snakemake.output.manifest,
        sums=snakemake.output.sums,
    )
