"""A document: numbers and tables between its marks, and the claims that its sentences rest on."""

from sentences import speak_plainly

from unilateral.study.text import marks, verdicts


def main(document, numbers, blocks, claims):
    holding = verdicts.holding(verdicts.read(claims))
    marks.fill(document, verdicts.read(numbers), verdicts.read(blocks), holding)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.output[0], snakemake.input.numbers, snakemake.input.blocks, snakemake.input.claims)
