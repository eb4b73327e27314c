"""Documents: numbers and tables between their marks, and the claims that their sentences rest on."""

from job import run

from unilateral.study.documents import marks, verdicts
from unilateral.study.ledger import records


def main(numbers, blocks, claims, documents):
    holding = verdicts.holding(records.read(claims))
    for document in documents:
        marks.fill(document, records.read(numbers), records.read(blocks), holding)


if __name__ == "__main__":
    run(main, snakemake)
