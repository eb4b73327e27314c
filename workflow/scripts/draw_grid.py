"""A scene's map over (h, H)."""

from unilateral import plots

if __name__ == "__main__":
    plots.grid(snakemake.input.table, snakemake.output[0])
