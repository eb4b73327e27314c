"""||lambda - lambda_H||_{-1/2} on one partition of a scene, for all its cases and levels."""

from scenes import cases, partitions
from sentences import speak_plainly

from unilateral import tables
from unilateral.dual_norm import dual_errors


def main(solutions, scene, name, k, path):
    levels = tables.along_mesh([tables.load(solution) for solution in solutions])
    tables.save(dual_errors(levels.isel(partition=[k]), cases(scene), partitions(scene)[k]), path, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.solutions,
        snakemake.params.scene,
        snakemake.wildcards.scene,
        int(snakemake.wildcards.partition),
        snakemake.output[0],
    )
