"""Errors over the exponents and the positions of a transition, along h/H and along H at one h, and rates."""

from functools import cache

from job import run

from unilateral.fem.condense import condense
from unilateral.formulas.symbolic import number_of
from unilateral.geometry import partition, polygon
from unilateral.geometry.structured import structured
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.experiments.sharpness import measure as sharpness
from unilateral.study.experiments.sharpness.surfaces import along_levels, rates_over


def main(study, stop, errors, rates, fixed_errors, fixed_rates):
    domain, fixed = polygon.named(study["polygon"]), study["fixed"]
    exponents = [
        [number_of(each, f"sharpness.{name}") for each in study[name]] for name in ("alphas", "gammas")
    ]
    chosen, given = Stop(**stop, algorithm=study["algorithm"]), {"sharpness": study, "stop": stop}

    @cache
    def on_mesh(h):
        return condense(structured(domain, float(h)))

    @cache
    def seen(H):
        places = sharpness.places(H, study["positions"])
        return sharpness.seen(partition.uniform(domain, float(H)), places, exponents)

    @cache
    def level(h, H):
        found = sharpness.measure(on_mesh(h), seen(H), chosen)
        print(f"h = {h}, H = {H} solved")
        return found

    def save(levels, to_errors, to_rates):
        table = along_levels(levels)
        tables.save(table, to_errors, "sharpness", given)
        tables.save(rates_over(table), to_rates, "sharpness", given)

    ratio = number_of(study["h_over_H"], "sharpness.h_over_H")
    sizes = [number_of(H, "sharpness.H") for H in study["H"]]
    save([level(ratio * H, H) for H in sizes], errors, rates)
    h = number_of(fixed["h"], "sharpness.fixed.h")
    sizes = [number_of(H, "sharpness.fixed.H") for H in fixed["H"]]
    save([level(h, H) for H in sizes], fixed_errors, fixed_rates)


if __name__ == "__main__":
    run(main, snakemake)
