"""All axes of extreme problems in one table."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.runs import extremes


def main(parts, path):
    tables.save(extremes.joined([tables.load(part) for part in parts]), path, "extremes")


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.parts, snakemake.output[0])
