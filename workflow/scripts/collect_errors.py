"""The tables of a scene from those of its levels and partitions."""

from sentences import speak_plainly

from unilateral import tables


def main(solutions, norms, timings, name, errors_path, timings_path):
    levels = tables.along_mesh([tables.load(path) for path in solutions]).drop_vars("lambda_H")
    dual = tables.along_partition([tables.load(path) for path in norms])
    tables.save(levels.merge(dual, join="exact", compat="equals"), errors_path, name)
    tables.save(tables.along_mesh([tables.load(path) for path in timings]), timings_path, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.solutions,
        snakemake.input.norms,
        snakemake.input.timings,
        snakemake.wildcards.scene,
        snakemake.output.errors,
        snakemake.output.timings,
    )
