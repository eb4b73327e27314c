"""Errors on one mesh over cells of many sizes."""

from job import run

from unilateral.formulas.formula import real
from unilateral.formulas.symbolic import number_of
from unilateral.geometry.structured import structured
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.experiments.cells.alternating import measure as measure_alternating
from unilateral.study.experiments.cells.measure import measure
from unilateral.study.scenes import cases, domain


def main(study, stop, errors, alternating):
    mesh = structured(domain(study), real(study["h"], "cells.h"))
    sizes = [real(H, "cells.H") for H in study["H"]]
    chosen = Stop(**stop, algorithm=study["algorithm"])
    table = measure(mesh, cases(study), sizes, study["period"], chosen)
    given = {"cells": study, "stop": stop}
    tables.save(table, errors, "cells", given)
    sizes, gammas = (
        [number_of(x, "cells.alternating") for x in study["alternating"][of]] for of in ("H", "gammas")
    )
    mesh = structured(domain(study), real(study["alternating"]["h"], "cells.alternating.h"))
    alpha = number_of(study["alternating"]["alpha"], "cells.alternating.alpha")
    tables.save(measure_alternating(mesh, sizes, alpha, gammas, chosen), alternating, "cells", given)


if __name__ == "__main__":
    run(main, snakemake)
