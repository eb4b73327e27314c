"""Guaranteed total errors of a scene's coarser levels, over the true ones."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.geometry import mesh
from unilateral.study import tables
from unilateral.study.runs.totals import totals
from unilateral.study.scenes import cases, partitions, stored_mesh


def main(coarse, levels, scene, name, wanted, ratio, path):
    refined, found = stored_mesh(coarse, scene), []
    chosen = [case for case in cases(scene) if case.name in wanted]
    for k, level in enumerate(levels):
        refined = mesh.refine(refined) if k else refined
        found.append(
            totals(refined, partitions(scene), chosen, tables.load(level), 1 / real(ratio, "judged_ratio"))
        )
    tables.save(tables.along_mesh(found), path, name)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.mesh,
        snakemake.input.levels,
        snakemake.params.scene,
        snakemake.wildcards.scene,
        snakemake.params.cases,
        snakemake.params.ratio,
        snakemake.output[0],
    )
