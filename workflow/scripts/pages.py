"""The pages of the report."""

from job import run

from study.documents.pages import typeset_pages

with run(snakemake):
    typeset_pages(
        numbers=snakemake.input.numbers,
        blocks=snakemake.input.blocks,
        claims=snakemake.input.claims,
        manifest=snakemake.input.manifest,
        parameters=snakemake.input.parameters,
        texts=snakemake.input.texts,
        front_text=snakemake.input.front_text,
        filter=snakemake.input.filter,
        template=snakemake.input.template,
        pages=snakemake.output.pages,
        front_page=snakemake.output.front_page,
    )
