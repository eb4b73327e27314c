"""The table behind a scene's figure of rates."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.figures import figure_data


def main(errors, rates, path):
    tables.save_csv(figure_data.rates_frame(tables.load(errors), tables.load(rates)), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.errors, snakemake.input.rates, snakemake.output[0])
