"""||.||_{-1/2} of a scene: its forms on the partitions' common refinement and on the cases' multipliers."""

from job import run

from unilateral.geometry.partition import common_refinement
from unilateral.norms import dual
from unilateral.study import tables
from unilateral.study.scenes import cases, partitions
from unilateral.study.sizes import normed


def main(scene, name, dual_norm):
    found = partitions(scene)
    finest, problems = common_refinement([found[k] for k in normed(scene)]), cases(scene)
    gram = dual.dual_norm(finest, problems).gram(problems)
    tables.save(gram.table(problems), dual_norm, name, {"scene": scene})


if __name__ == "__main__":
    run(main, snakemake)
