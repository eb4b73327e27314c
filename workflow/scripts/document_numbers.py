"""The numbers and tables of all documents."""

from job import run

from study.documents.numbers import write_numbers

with run(snakemake):
    write_numbers(
        files=snakemake.input.files,
        study=snakemake.params.study,
        numbers=snakemake.output.numbers,
        blocks=snakemake.output.blocks,
    )
