"""The figure of beta."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.infsup(snakemake.input.table, snakemake.output[0])
