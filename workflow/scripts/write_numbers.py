"""The named numbers and the tables of all documents."""

from job import run

from unilateral.study.text import blocks as shown
from unilateral.study.text import numbers as named
from unilateral.study.text import sources


def main(study, numbers, blocks, **paths):
    told = sources.read(paths, study)
    sources.write(named.collect(told), numbers)
    sources.write(shown.collect(told), blocks)


if __name__ == "__main__":
    run(main, snakemake)
