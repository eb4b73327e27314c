"""The ledger: every claim judged."""

from job import run

from study.ledger.claims import judge_claims

with run(snakemake):
    judge_claims(
        tables=snakemake.input.tables,
        claims=snakemake.output.claims,
    )
