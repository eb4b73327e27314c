"""A document: numbers and tables between its marks, and the claims that its sentences rest on."""

from sentences import speak_plainly

from unilateral.study.judge import records
from unilateral.study.text import marks, verdicts


def main(document, numbers, blocks, claims):
    holding = verdicts.holding(records.read(claims))
    marks.fill(document, records.read(numbers), records.read(blocks), holding)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.output[0], snakemake.input.numbers, snakemake.input.blocks, snakemake.input.claims)
