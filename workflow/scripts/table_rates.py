"""The table behind a scene's figure of rates."""

from unilateral import figure_data, tables


def main(errors, rates, path):
    tables.save_csv(figure_data.rates_frame(tables.load(errors), tables.load(rates)), path)


if __name__ == "__main__":
    main(snakemake.input.errors, snakemake.input.rates, snakemake.output[0])
