"""Every run of the study of cost on the meshes of one job."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.geometry.structured import structured
from unilateral.norms.dual import Gram
from unilateral.study import tables
from unilateral.study.runs.cost import measure as cost
from unilateral.study.runs.cost import variants
from unilateral.study.scenes import cases, domain


def main(norm, scene, study, job, results, timings):
    gram, problems = Gram.of_table(tables.load(norm)), cases(scene)
    planned = [variant for variant in variants.plan(study) if variant.scene == job["scene"]]
    sizes = [real(H, "cost.H") for H in study["H"]]
    limits = cost.Limits(study["stops"], study["max_steps"], study["costly_steps"])
    found = [
        cost.measure(
            structured(domain(scene), real(h, "cost.jobs.h")), problems, gram, planned, sizes, limits
        )
        for h in job["h"]
    ]
    for parts, path in zip(zip(*found, strict=True), (results, timings), strict=True):
        tables.save(cost.along_runs(parts, planned), path, "cost")


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.norm,
        snakemake.params.scene,
        snakemake.params.study,
        snakemake.params.job,
        snakemake.output.results,
        snakemake.output.timings,
    )
