"""The named numbers and the tables of all documents."""

from sentences import speak_plainly

from unilateral.study.text import blocks, numbers, sources


def main(given, study, to):
    told = sources.read(given, study)
    sources.write(numbers.collect(told), to["numbers"])
    sources.write(blocks.collect(told), to["blocks"])


if __name__ == "__main__":
    speak_plainly()
    main(dict(snakemake.input.items()), dict(snakemake.params.items()), dict(snakemake.output.items()))
