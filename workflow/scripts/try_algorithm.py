"""Uzawa's algorithm on one mesh, and what its steps cost on several."""

from job import run

from unilateral.formulas.formula import real
from unilateral.geometry import partition
from unilateral.geometry.structured import structured
from unilateral.study import tables
from unilateral.study.experiments.algorithm import certificates as trials
from unilateral.study.experiments.algorithm import formulation as statements
from unilateral.study.experiments.algorithm import measure as experiments
from unilateral.study.scenes import cases, domain


def main(study, steps, certificates, singular, uniqueness, unique, elimination, split, formulation):
    polygon = domain(study)
    h, H = (real(study[name], f"algorithm.{name}") for name in ("h", "H"))
    on, cells = structured(polygon, h), partition.uniform(polygon, H)
    problems, given = cases(study), {"algorithm": study}
    shares = [float(share) for share in study["shares"]]
    tables.save(experiments.algorithm(on, cells, problems, shares, study["steps"]), steps, "algorithm", given)
    recorded = study["recorded_steps"]
    for size, path in ((H, certificates), (h, singular)):
        found = trials.certificates(on, partition.uniform(polygon, size), problems, recorded)
        tables.save(found, path, "algorithm", given)
    for size, path in ((h, uniqueness), (H, unique)):
        tables.save(trials.uniqueness(on, partition.uniform(polygon, size)), path, "algorithm", given)
    sizes = [real(size, "algorithm.eliminated") for size in study["eliminated"]]
    meshes = [structured(polygon, size) for size in sizes]
    partitions = [partition.uniform(polygon, size * H / h) for size in sizes]
    found = trials.elimination(meshes, partitions, study["compared_steps"])
    tables.save(found, elimination, "algorithm", given)
    tables.save(trials.split(on, cells, problems), split, "algorithm", given)
    tables.save(statements.formulation(on, cells, problems), formulation, "algorithm", given)


if __name__ == "__main__":
    run(main, snakemake)
