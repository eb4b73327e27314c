"""The finest mesh that is asked for, and what memory allows."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.runs import extremes


def main(study, path):
    h, H = (real(study[name], f"deep.{name}") for name in ("h", "H"))
    budget = extremes.Budget(study["accuracy"], study["max_steps"])
    tables.save(extremes.deep(h, H, study["memory"], budget), path, "deep")


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.study, snakemake.output[0])
