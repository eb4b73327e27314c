"""All axes of extreme problems."""

from job import run

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.experiments.extremes.measure import Budget, survey


def main(study, extremes):
    h, H = (real(study[name], f"extremes.{name}") for name in ("h", "H"))
    budget = Budget(study["accuracy"], study["max_steps"])
    tables.save(survey(study["axes"], h, H, budget), extremes, "extremes", {"extremes": study})


if __name__ == "__main__":
    run(main, snakemake)
