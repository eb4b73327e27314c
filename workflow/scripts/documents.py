"""The numbers and tables of the documents, filled in."""

from job import run

from study.documents.marks import fill_documents

with run(snakemake):
    fill_documents(
        numbers=snakemake.input.numbers,
        blocks=snakemake.input.blocks,
        claims=snakemake.input.claims,
        documents=snakemake.output.documents,
    )
