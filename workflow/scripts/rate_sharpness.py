"""Rates over the exponents, measured and predicted."""

from sentences import speak_plainly

from unilateral import surfaces, tables


def main(errors, path):
    tables.save(surfaces.rates_over(tables.load(errors)), path, "sharpness")


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.errors, snakemake.output[0])
