"""The table of the sharpness study from those of its levels."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.judge import surfaces


def main(levels, path):
    tables.save(surfaces.along_levels([tables.load(level) for level in levels]), path, "sharpness")


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.levels, snakemake.output[0])
