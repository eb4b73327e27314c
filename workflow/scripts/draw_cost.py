"""The work-precision diagrams."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.work_precision(snakemake.input.table, snakemake.output[0], snakemake.params.work)
