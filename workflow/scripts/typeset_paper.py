"""The paper as HTML and as PDF."""

from job import run

from unilateral.study.documents.typesetting import typeset

if __name__ == "__main__":
    run(typeset, snakemake)
