"""The figure of where it breaks."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.extremes(snakemake.input.table, snakemake.output[0])
