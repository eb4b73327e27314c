"""One level of the scene `deep`, and what it took."""

from time import process_time

import xarray as xr
from job import run

from unilateral.formulas.formula import real
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.experiments.deep import measure as deep
from unilateral.study.scenes import cases
from unilateral.system.memory import peak_mb


def main(scene, h, stop, errors, timings):
    size, ratio = real(h, "deep.h"), real(scene["H_over_h"], "deep.H_over_h")
    found = deep.level(cases(scene), size, ratio, Stop(**stop))
    given = {"deep": scene, "stop": stop}
    tables.save(found, errors, "deep", given)
    taken = {"h": [size], "process_seconds": [process_time()], "peak_mb": [peak_mb()]}
    tables.save(xr.Dataset({name: ("mesh", value) for name, value in taken.items()}), timings, "deep", given)


if __name__ == "__main__":
    run(main, snakemake)
