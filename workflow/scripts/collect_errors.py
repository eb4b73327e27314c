"""The tables of a scene from those of its levels."""

from job import run

from unilateral.norms.infsup import of_runs
from unilateral.study import tables


def main(solutions, timed, name, errors, infsup, timings):
    found = tables.along_mesh([tables.load(path) for path in solutions]).drop_vars("lambda_H")
    tables.save(found, errors, name)
    tables.save(of_runs(found), infsup, name)
    tables.save(tables.along_mesh([tables.load(path) for path in timed]), timings, name)


if __name__ == "__main__":
    run(main, snakemake)
