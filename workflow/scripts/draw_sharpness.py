"""The figure of sharpness."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.sharpness(snakemake.input.table, snakemake.output[0])
