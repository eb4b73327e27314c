"""The picture of one solution."""

from sentences import speak_plainly

from unilateral.study import figures as plots

if __name__ == "__main__":
    speak_plainly()
    plots.portrait(snakemake.input.mesh, snakemake.input.boundary, snakemake.output[0])
