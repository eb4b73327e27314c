"""Some axes of extreme problems."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.runs import extremes


def main(study, axes, path):
    h, H = (real(study[name], f"extremes.{name}") for name in ("h", "H"))
    budget = extremes.Budget(study["accuracy"], study["max_steps"])
    tables.save(extremes.survey(axes, h, H, budget), path, "extremes")


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.study, snakemake.params.axes, snakemake.output[0])
