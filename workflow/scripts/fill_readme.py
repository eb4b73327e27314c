"""README.md: its table of rates."""

from sentences import speak_plainly

from unilateral import documents, tables
from unilateral.expression import real


def main(paths, scenes, ratio, readme):
    found = {name: tables.load(path) for name, path in zip(scenes, paths, strict=True)}
    documents.fill(readme, {"rates": documents.rates_table(found, real(ratio, "judged_ratio"))})


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.rates, snakemake.params.scenes, snakemake.params.judged_ratio, snakemake.output[0])
