"""The table behind the figure of the worst multipliers."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.figures import infsup_data


def main(survey, ratios, path):
    h_over_H = [real(ratio, "multiplier.h_over_H") for ratio in ratios]
    tables.save_csv(infsup_data.multiplier_frame(tables.load(survey), h_over_H), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.survey, snakemake.params.h_over_H, snakemake.output[0])
