"""A scene's figure of rates."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.rates(snakemake.input.table, snakemake.output[0])
