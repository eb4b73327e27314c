"""The picture of one solution."""

from unilateral import plots

if __name__ == "__main__":
    plots.portrait(snakemake.input.mesh, snakemake.input.boundary, snakemake.output[0])
