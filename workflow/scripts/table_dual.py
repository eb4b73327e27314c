"""The table behind a scene's figure of the dual norm."""

from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.norms.dual import Gram
from unilateral.study import tables
from unilateral.study.figures import infsup_data
from unilateral.study.scenes import partitions
from unilateral.study.sizes import normed


def main(errors, norm, scene, ratio, path):
    cells = {k: partitions(scene)[k] for k in normed(scene)}
    gram = Gram.of_table(tables.load(norm))
    frame = infsup_data.dual_norm_frame(tables.load(errors), gram, cells, real(ratio, "judged_ratio"))
    tables.save_csv(frame, path)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.errors,
        snakemake.input.norm,
        snakemake.params.scene,
        snakemake.params.h_over_H,
        snakemake.output[0],
    )
