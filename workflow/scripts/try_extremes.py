"""Some axes of extreme problems."""

from job import run

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.runs import extremes


def main(study, axes, part):
    h, H = (real(study[name], f"extremes.{name}") for name in ("h", "H"))
    budget = extremes.Budget(study["accuracy"], study["max_steps"])
    tables.save(extremes.survey(axes, h, H, budget), part, "extremes")


if __name__ == "__main__":
    run(main, snakemake)
