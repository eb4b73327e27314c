"""The coarsest mesh of a scene."""

from scenes import coarsest_mesh
from sentences import speak_plainly

from unilateral.geometry import mesh


def main(scene, path):
    mesh.write(coarsest_mesh(scene), path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.scene, snakemake.output[0])
