"""Every case on every partition of a scene, on the coarsest mesh refined `level` times."""

from sentences import speak_plainly

from unilateral.geometry import mesh
from unilateral.norms.dual import Gram
from unilateral.solvers.iterate import Stop
from unilateral.study import tables
from unilateral.study.runs.scene import sweep
from unilateral.study.scenes import cases, partitions, stored_mesh
from unilateral.study.sizes import limits


def main(coarse, norm, scene, name, level, stop, results, timings):
    refined = stored_mesh(coarse, scene)
    for _ in range(level):
        refined = mesh.refine(refined)
    gram = Gram.of_table(tables.load(norm)) if norm else None
    solved, timed = sweep(refined, cases(scene), partitions(scene), gram, limits(scene), Stop(**stop))
    tables.save(solved, results, name)
    tables.save(timed, timings, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.mesh,
        snakemake.input.norm,
        snakemake.params.scene,
        snakemake.wildcards.scene,
        int(snakemake.wildcards.level),
        snakemake.params.stop,
        snakemake.output.solutions,
        snakemake.output.timings,
    )
