"""||.||_{-1/2} of a scene: its forms on the partitions' common refinement and on the cases' multipliers."""

from sentences import speak_plainly

from unilateral.geometry.partition import common_refinement
from unilateral.norms.dual import dual_norm
from unilateral.study import tables
from unilateral.study.scenes import cases, partitions
from unilateral.study.sizes import normed


def main(scene, name, path):
    found = partitions(scene)
    finest, problems = common_refinement([found[k] for k in normed(scene)]), cases(scene)
    gram = dual_norm(finest, problems).gram(problems)
    tables.save(gram.table(problems), path, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.params.scene,
        snakemake.wildcards.scene,
        snakemake.output[0],
    )
