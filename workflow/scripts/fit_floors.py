"""The floors that h and H leave in the H1 errors of a scene."""

from job import run

from unilateral.formulas.formula import real
from unilateral.problems import case
from unilateral.study import tables
from unilateral.study.experiments.scenes.floors import floors as fitted


def main(errors, name, ratio, floors):
    table = tables.load(errors)
    declared = {c: case.declared(c)[0]["asymptotic"]["h1"]["from"] for c in table["case"].values}
    starts = {c: real(start, f"case '{c}', asymptotic.h1.from") for c, start in declared.items()}
    found = fitted(table, starts, real(ratio, "judged_ratio"))
    tables.save(found, floors, name, {"rates.judged_ratio": ratio})


if __name__ == "__main__":
    run(main, snakemake)
