"""||.||_{-1/2} on one partition of a scene: its forms on P0(T_H) and on the cases' multipliers."""

from scenes import cases, partitions
from sentences import speak_plainly

from unilateral import tables
from unilateral.dual_norm import dual_norm


def main(scene, name, k, path):
    partition, problems = partitions(scene)[k], cases(scene)
    gram = dual_norm(partition, problems).gram(problems)
    tables.save(gram.table(partition, problems), path, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.params.scene,
        snakemake.wildcards.scene,
        int(snakemake.wildcards.partition),
        snakemake.output[0],
    )
