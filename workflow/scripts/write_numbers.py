"""The named numbers and the tables of all documents."""

from job import run

from unilateral.study.documents import blocks as shown
from unilateral.study.documents import numbers as named
from unilateral.study.documents import sources


def main(study, numbers, blocks, **paths):
    told = sources.read(paths, study)
    sources.write(named.collect(told), numbers)
    sources.write(shown.collect(told), blocks)


if __name__ == "__main__":
    run(main, snakemake)
