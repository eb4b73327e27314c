"""All axes of extreme problems in one table."""

from job import run

from unilateral.study import tables
from unilateral.study.runs.extremes import joined


def main(parts, extremes):
    tables.save(joined([tables.load(part) for part in parts]), extremes, "extremes")


if __name__ == "__main__":
    run(main, snakemake)
