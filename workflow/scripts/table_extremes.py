"""The table behind the figure of where it breaks."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.figures import extremes_data


def main(extremes, path):
    tables.save_csv(extremes_data.frame(tables.load(extremes)), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.extremes, snakemake.output[0])
