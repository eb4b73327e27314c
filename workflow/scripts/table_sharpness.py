"""The table behind the figure of sharpness."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.judge import surfaces


def main(rates, path):
    tables.save_csv(surfaces.sharpness_frame(tables.load(rates)), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.rates, snakemake.output[0])
