"""The table behind a scene's map over (h, H)."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.figures import figure_data


def main(errors, cases, path):
    tables.save_csv(figure_data.grid_frame(tables.load(errors), cases), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.errors, snakemake.params.cases, snakemake.output[0])
