"""A scene's map over (h, H)."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.grid(snakemake.input.table, snakemake.output[0])
