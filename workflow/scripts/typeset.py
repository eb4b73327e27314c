"""The paper, or its supplement, as HTML and PDF."""

from job import run

from study.documents.typesetting import typeset_paper

with run(snakemake):
    typeset_paper(
        paper=snakemake.input.paper,
        numbers=snakemake.input.numbers,
        page_template=snakemake.input.page_template,
        print_template=snakemake.input.print_template,
        html=snakemake.output.html,
        pdf=snakemake.output.pdf,
    )
