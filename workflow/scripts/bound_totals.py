"""Guaranteed total errors of a scene's coarser levels, over the true ones."""

from job import run

from unilateral.formulas.formula import real
from unilateral.geometry.mesh import refine
from unilateral.study import tables
from unilateral.study.runs.totals import totals as bounded
from unilateral.study.scenes import cases, partitions, stored_mesh


def main(mesh, levels, scene, name, wanted, ratio, totals):
    refined, found = stored_mesh(mesh, scene), []
    chosen = [case for case in cases(scene) if case.name in wanted]
    for k, level in enumerate(levels):
        refined = refine(refined) if k else refined
        h_over_H = real(ratio, "judged_ratio")
        found.append(bounded(refined, partitions(scene), chosen, tables.load(level), 1 / h_over_H))
    tables.save(tables.along_mesh(found), totals, name)


if __name__ == "__main__":
    run(main, snakemake)
