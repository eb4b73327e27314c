"""Errors over the exponents and the positions of a transition on all levels, and their rates."""

from job import run

from unilateral.formulas.formula import number
from unilateral.geometry import partition, polygon
from unilateral.geometry.structured import structured
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.judge.surfaces import along_levels, rates_over
from unilateral.study.runs import sharpness


def main(study, stop, errors, rates):
    domain, found = polygon.named(study["polygon"]), []
    exponents = [[number(each, f"sharpness.{name}") for each in study[name]] for name in ("alphas", "gammas")]
    for size in [number(H, "sharpness.H") for H in study["H"]]:
        h = size * number(study["h_over_H"], "sharpness.h_over_H")
        places = sharpness.places(size, study["positions"])
        mesh, cells = structured(domain, float(h)), partition.uniform(domain, float(size))
        chosen = Stop(**stop, algorithm=study["algorithm"])
        found.append(sharpness.measure(mesh, cells, places, exponents, chosen))
        print(f"H = {size} solved")
    table, given = along_levels(found), {"study": study, "stop": stop}
    tables.save(table, errors, "sharpness", given)
    tables.save(rates_over(table), rates, "sharpness", given)


if __name__ == "__main__":
    run(main, snakemake)
