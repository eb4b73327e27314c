"""A document: numbers and tables between its marks, and the claims that its sentences rest on."""

from job import run

from unilateral.study.judge import records
from unilateral.study.text import marks, verdicts


def main(numbers, blocks, claims, document):
    holding = verdicts.holding(records.read(claims))
    marks.fill(document, records.read(numbers), records.read(blocks), holding)


if __name__ == "__main__":
    run(main, snakemake)
