"""The tables of a scene from those of its levels."""

from sentences import speak_plainly

from unilateral.norms import infsup
from unilateral.study import tables


def main(solutions, timings, name, errors_path, infsup_path, timings_path):
    errors = tables.along_mesh([tables.load(path) for path in solutions]).drop_vars("lambda_H")
    tables.save(errors, errors_path, name)
    tables.save(infsup.of_runs(errors), infsup_path, name)
    tables.save(tables.along_mesh([tables.load(path) for path in timings]), timings_path, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.solutions,
        snakemake.input.timings,
        snakemake.wildcards.scene,
        snakemake.output.errors,
        snakemake.output.infsup,
        snakemake.output.timings,
    )
