"""What is certain of contact, against exact contact sets."""

from job import run

from study.experiments.certain.measure import measure_certain

with run(snakemake):
    measure_certain(
        study=snakemake.params.study,
        contact=snakemake.output.contact,
    )
