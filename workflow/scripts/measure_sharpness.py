"""Errors over the exponents and the positions of a transition, along h/H and along H at one h, and rates."""

from job import run

from unilateral.fem.condense import condense
from unilateral.formulas.symbolic import number_of
from unilateral.geometry import partition, polygon
from unilateral.geometry.structured import structured
from unilateral.solvers.stop import Stop
from unilateral.study import tables
from unilateral.study.judge.surfaces import along_levels, rates_over
from unilateral.study.runs import sharpness


def main(study, stop, errors, rates, fixed_errors, fixed_rates):
    domain, fixed = polygon.named(study["polygon"]), study["fixed"]
    exponents = [
        [number_of(each, f"sharpness.{name}") for each in study[name]] for name in ("alphas", "gammas")
    ]
    chosen, given = Stop(**stop, algorithm=study["algorithm"]), {"sharpness": study, "stop": stop}

    def on_mesh(h):
        return condense(structured(domain, float(h)))

    def level(condensed, H):
        cells, places = partition.uniform(domain, float(H)), sharpness.places(H, study["positions"])
        found = sharpness.measure(condensed, cells, places, exponents, chosen)
        print(f"h = {condensed.mesh.h:.4g}, H = {H} solved")
        return found

    def save(levels, to_errors, to_rates):
        table = along_levels(levels)
        tables.save(table, to_errors, "sharpness", given)
        tables.save(rates_over(table), to_rates, "sharpness", given)

    ratio = number_of(study["h_over_H"], "sharpness.h_over_H")
    sizes = [number_of(H, "sharpness.H") for H in study["H"]]
    save([level(on_mesh(ratio * H), H) for H in sizes], errors, rates)
    one = on_mesh(number_of(fixed["h"], "sharpness.fixed.h"))
    sizes = [number_of(H, "sharpness.fixed.H") for H in fixed["H"]]
    save([level(one, H) for H in sizes], fixed_errors, fixed_rates)


if __name__ == "__main__":
    run(main, snakemake)
