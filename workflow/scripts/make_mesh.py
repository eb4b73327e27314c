"""The coarsest mesh of a scene."""

from job import run

from unilateral.geometry.mesh_files import write
from unilateral.study.scenes import coarsest_mesh


def main(scene, mesh):
    write(coarsest_mesh(scene), mesh)


if __name__ == "__main__":
    run(main, snakemake)
