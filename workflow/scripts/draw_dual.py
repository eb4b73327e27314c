"""A scene's figure of the dual norm."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.dual_norm(snakemake.input.table, snakemake.output[0])
