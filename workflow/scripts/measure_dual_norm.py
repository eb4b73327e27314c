"""||.||_{-1/2} of a scene: its forms on the partitions' common refinement and on the cases' multipliers."""

from job import run

from unilateral.geometry.partition import common_refinement
from unilateral.study import tables
from unilateral.study.experiments.estimates.forms import dual_forms
from unilateral.study.scenes import cases, partitions
from unilateral.study.sizes import normed


def main(scene, name, dual_norm):
    found = partitions(scene)
    finest, problems = common_refinement([found[k] for k in normed(scene)]), cases(scene)
    tables.save(dual_forms(finest, problems), dual_norm, name, {f"scenes.{name}": scene})


if __name__ == "__main__":
    run(main, snakemake)
