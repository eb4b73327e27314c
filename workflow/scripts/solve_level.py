"""Every case on every partition of a scene, on the coarsest mesh refined `level` times."""

from job import run

from unilateral.geometry.mesh import refine
from unilateral.norms.dual import Gram
from unilateral.solvers.iterate import Stop
from unilateral.study import tables
from unilateral.study.runs.scene import sweep
from unilateral.study.scenes import cases, partitions, stored_mesh
from unilateral.study.sizes import limits


def main(mesh, norm, scene, name, level, stop, solutions, timings):
    refined = stored_mesh(mesh, scene)
    for _ in range(level):
        refined = refine(refined)
    gram = Gram.of_table(tables.load(norm)) if norm else None
    solved, timed = sweep(refined, cases(scene), partitions(scene), gram, limits(scene), Stop(**stop))
    tables.save(solved, solutions, name)
    tables.save(timed, timings, name)


if __name__ == "__main__":
    run(main, snakemake)
