"""The page on which a case, a norm and h/H are chosen."""

from job import run

from study.documents.curves import write_curves

with run(snakemake):
    write_curves(
        errors=snakemake.input.errors,
        rates=snakemake.input.rates,
        totals=snakemake.input.totals,
        template=snakemake.input.template,
        page=snakemake.output.page,
    )
