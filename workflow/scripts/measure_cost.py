"""Every run of the study of cost on the meshes of one job."""

from job import run

from unilateral.formulas.formula import real
from unilateral.geometry.structured import structured
from unilateral.norms.dual import Gram
from unilateral.study import tables
from unilateral.study.experiments.cost import measure as cost
from unilateral.study.experiments.cost.variants import plan
from unilateral.study.scenes import cases, domain


def main(norm, scene, number, of_job, study, runs, timings):
    name, h = of_job["scene"], of_job["h"]
    gram, problems = Gram.of_table(tables.load(norm)), cases(scene)
    planned = [variant for variant in plan(study) if variant.scene == name]
    sizes = [real(H, "cost.H") for H in study["H"]]
    limits = cost.StepLimits(study["stops"], study["max_steps"], study["costly_steps"])
    meshes = [structured(domain(scene), real(size, "cost.jobs.h")) for size in h]
    found = [cost.measure(mesh, problems, gram, planned, sizes, limits) for mesh in meshes]
    given = {f"scenes.{name}": scene, f"cost.jobs.{number}": of_job}
    given |= {f"cost.{field}": value for field, value in study.items()}
    for parts, path in zip(zip(*found, strict=True), (runs, timings), strict=True):
        tables.save(cost.along_runs(parts, planned), path, "cost", given)


if __name__ == "__main__":
    run(main, snakemake)
