"""README.md: its table of rates."""

from unilateral import documents, rates, tables


def main(paths, scenes, ratio, readme):
    found = {name: tables.load(path) for name, path in zip(scenes, paths, strict=True)}
    documents.fill(readme, {"rates": documents.rates_table(found, rates.fraction(ratio))})


if __name__ == "__main__":
    main(
        snakemake.input.rates, snakemake.params.scenes, snakemake.params.judged_ratio, snakemake.output[0]
    )
