"""The figure of sharpness."""

from sentences import speak_plainly

from unilateral import plots

if __name__ == "__main__":
    speak_plainly()
    plots.sharpness(snakemake.input.table, snakemake.output[0])
