"""Guaranteed total errors of a scene's coarser levels, over the true ones."""

from job import run

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.experiments.scenes.totals import totals as bounded
from unilateral.study.scenes import cases, partitions, refinements, stored_mesh


def main(mesh, solutions, scene, name, levels, wanted, ratio, totals):
    chosen = [case for case in cases(scene) if case.name in wanted]
    H_over_h, solved = 1 / real(ratio, "judged_ratio"), tables.load(solutions)
    found = [
        bounded(refined, partitions(scene), chosen, solved.isel(mesh=[level]), H_over_h)
        for level, refined in enumerate(refinements(stored_mesh(mesh, scene), levels))
    ]
    given = {f"scenes.{name}": scene, "totals.levels": levels, f"totals.scenes.{name}": wanted}
    given |= {"rates.judged_ratio": ratio}
    tables.save(tables.along_mesh(found), totals, name, given)


if __name__ == "__main__":
    run(main, snakemake)
