"""The coarsest mesh of a scene."""

from sentences import speak_plainly

from unilateral.geometry.mesh_files import write
from unilateral.study.scenes import coarsest_mesh


def main(scene, path):
    write(coarsest_mesh(scene), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.scene, snakemake.output[0])
