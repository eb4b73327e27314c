"""A scene's figure of rates."""

from unilateral import plots

if __name__ == "__main__":
    plots.rates(snakemake.input.table, snakemake.output[0])
