"""Errors over the exponents and the positions of a transition, on one level."""

from job import run

from unilateral.formulas.formula import number
from unilateral.geometry import partition, polygon
from unilateral.geometry.structured import structured
from unilateral.solvers.iterate import Stop
from unilateral.study import tables
from unilateral.study.runs import sharpness


def main(study, stop, H, errors):
    domain, size = polygon.named(study["polygon"]), number(H, "sharpness.H")
    h = size * number(study["h_over_H"], "sharpness.h_over_H")
    exponents = [[number(each, f"sharpness.{name}") for each in study[name]] for name in ("alphas", "gammas")]
    found = sharpness.measure(
        structured(domain, float(h)),
        partition.uniform(domain, float(size)),
        sharpness.places(size, study["positions"]),
        exponents,
        Stop(**stop, algorithm=study["algorithm"]),
    )
    tables.save(found, errors, "sharpness")


if __name__ == "__main__":
    run(main, snakemake)
