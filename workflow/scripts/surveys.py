"""beta over families of meshes and partitions."""

from job import run

from study.experiments.stability.measure import survey_infsup

with run(snakemake):
    survey_infsup(
        study=snakemake.params.study,
        finds=snakemake.params.finds,
        tables=snakemake.output.tables,
    )
