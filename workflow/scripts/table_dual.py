"""The table behind a scene's figure of the dual norm."""

from sentences import speak_plainly

from unilateral import infsup_data, tables
from unilateral.expression import real


def main(errors, forms, ratio, path):
    loaded = {k: tables.load(form) for k, form in forms.items()}
    frame = infsup_data.dual_norm_frame(tables.load(errors), loaded, real(ratio, "judged_ratio"))
    tables.save_csv(frame, path)


if __name__ == "__main__":
    speak_plainly()
    main(
        snakemake.input.errors,
        dict(zip(snakemake.params.normed, snakemake.input.norms, strict=True)),
        snakemake.params.h_over_H,
        snakemake.output[0],
    )
