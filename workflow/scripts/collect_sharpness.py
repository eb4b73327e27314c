"""The sharpness study's table of errors from those of its levels, and its rates, measured and predicted."""

from job import run

from unilateral.study import tables
from unilateral.study.judge.surfaces import along_levels, rates_over


def main(levels, errors, rates):
    found = along_levels([tables.load(level) for level in levels])
    tables.save(found, errors, "sharpness")
    tables.save(rates_over(found), rates, "sharpness")


if __name__ == "__main__":
    run(main, snakemake)
