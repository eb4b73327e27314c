"""The tables behind the picture of one solution."""

from unilateral import case, figure_data, mesh, partition, polygon, tables
from unilateral.rates import fraction


def main(portrait, mesh_path, boundary_path):
    domain = polygon.named(portrait["polygon"])
    field, boundary = figure_data.portrait_frames(
        case.load(portrait["case"], domain),
        mesh.structured(domain, fraction(portrait["h"])),
        partition.uniform(domain, fraction(portrait["H"])),
    )
    tables.save_csv(field, mesh_path)
    tables.save_csv(boundary, boundary_path)


if __name__ == "__main__":
    main(snakemake.params.portrait, snakemake.output.mesh, snakemake.output.boundary)
