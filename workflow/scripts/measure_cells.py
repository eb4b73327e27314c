"""Errors on one mesh over cells of many sizes."""

from job import run

from unilateral.formulas.formula import real
from unilateral.geometry.structured import structured
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.runs.cells import measure
from unilateral.study.scenes import cases, domain


def main(study, stop, errors):
    mesh = structured(domain(study), real(study["h"], "cells.h"))
    sizes = [real(H, "cells.H") for H in study["H"]]
    chosen = Stop(**stop, algorithm=study["algorithm"])
    table = measure(mesh, cases(study), sizes, study["period"], chosen)
    tables.save(table, errors, "cells", {"study": study, "stop": stop})


if __name__ == "__main__":
    run(main, snakemake)
