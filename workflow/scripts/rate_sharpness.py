"""Rates over the exponents, measured and predicted."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.judge import surfaces


def main(errors, path):
    tables.save(surfaces.rates_over(tables.load(errors)), path, "sharpness")


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.errors, snakemake.output[0])
