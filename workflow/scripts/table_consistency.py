"""The table behind the figure of the consistency term."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.runs.consistency import consistency_frame
from unilateral.study.scenes import cases, partitions


def main(errors, drawn, scenes, path):
    studies = [(cases(scene), tables.load(of)) for scene, of in zip(scenes, errors, strict=True)]
    tables.save_csv(consistency_frame(*cases(drawn), *partitions(drawn), studies), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.input.errors, snakemake.params.drawn, snakemake.params.scenes, snakemake.output[0])
