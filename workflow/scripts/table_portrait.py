"""The tables behind the picture of one solution."""

from unilateral import case, figure_data, mesh, partition, polygon, tables
from unilateral.expression import real


def main(portrait, mesh_path, boundary_path):
    domain = polygon.named(portrait["polygon"])
    field, boundary = figure_data.portrait_frames(
        case.load(portrait["case"], domain),
        mesh.structured(domain, real(portrait["h"], "h")),
        partition.uniform(domain, real(portrait["H"], "H")),
    )
    tables.save_csv(field, mesh_path)
    tables.save_csv(boundary, boundary_path)


if __name__ == "__main__":
    main(snakemake.params.portrait, snakemake.output.mesh, snakemake.output.boundary)
