"""The floors that h and H leave in the H1 errors of a scene."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.problems import case
from unilateral.study import tables
from unilateral.study.judge import floors


def main(errors, ratio, name, path):
    table = tables.load(errors)
    declared = {c: case.declared(c)[0]["asymptotic"]["h1"]["from"] for c in table["case"].values}
    starts = {c: real(start, f"case '{c}', asymptotic.h1.from") for c, start in declared.items()}
    tables.save(floors.floors(table, starts, real(ratio, "judged_ratio")), path, name)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.errors, snakemake.params.ratio, snakemake.wildcards.scene, snakemake.output[0])
