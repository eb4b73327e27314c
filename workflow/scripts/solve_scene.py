"""Every case on every partition of a scene, on its coarsest mesh and on the refinements of that."""

from job import run

from unilateral.geometry.mesh_files import write
from unilateral.norms.dual import Gram
from unilateral.norms.infsup import of_runs
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.experiments.scenes.measure import sweep
from unilateral.study.scenes import cases, coarsest_mesh, partitions, refinements
from unilateral.study.sizes import limits


def main(norm, scene, name, stop, mesh, solutions, errors, infsup, timings):
    gram = Gram.of_table(tables.load(norm)) if norm else None
    problems, cells, found = cases(scene), partitions(scene), []
    coarsest = coarsest_mesh(scene)
    write(coarsest, mesh)
    for refined in refinements(coarsest, scene["mesh"]["levels"]):
        found.append(sweep(refined, problems, cells, gram, limits(scene), Stop(**stop)))
        print(f"h = {refined.h:.4g} solved")
    solved, timed = (tables.along_mesh(levels) for levels in zip(*found, strict=True))
    given = {f"scenes.{name}": scene, "stop": stop}
    tables.save(solved, solutions, name, given)
    tables.save(solved.drop_vars("lambda_H"), errors, name, given)
    tables.save(of_runs(solved), infsup, name, given)
    tables.save(timed, timings, name, given)


if __name__ == "__main__":
    run(main, snakemake)
