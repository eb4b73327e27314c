"""Errors over the exponents and the positions of a transition, on one level."""

from sentences import speak_plainly

from unilateral.formulas.formula import number
from unilateral.geometry import partition, polygon
from unilateral.geometry.structured import structured
from unilateral.solvers.iterate import Stop
from unilateral.study import tables
from unilateral.study.runs import sharpness


def main(study, stop, level, path):
    domain, H = polygon.named(study["polygon"]), number(study["H"][level], "sharpness.H")
    h = H * number(study["h_over_H"], "sharpness.h_over_H")
    exponents = [[number(each, f"sharpness.{name}") for each in study[name]] for name in ("alphas", "gammas")]
    found = sharpness.measure(
        structured(domain, float(h)),
        partition.uniform(domain, float(H)),
        sharpness.places(H, study["positions"]),
        exponents,
        Stop(**stop, algorithm=study["algorithm"]),
    )
    tables.save(found, path, "sharpness")


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.params.study,
        snakemake.params.stop,
        int(snakemake.wildcards.level),
        snakemake.output[0],
    )
