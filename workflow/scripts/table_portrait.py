"""The tables behind the picture of one solution."""

from sentences import speak_plainly

from unilateral.study import tables
from unilateral.study.figures import figure_data
from unilateral.study.scenes import cases, coarsest_mesh, partitions


def main(portrait, mesh_path, boundary_path):
    scene = {
        "polygon": portrait["polygon"],
        "side": portrait["side"],
        "cases": [portrait["case"]],
        "mesh": {"kind": "structured", "h": portrait["h"]},
        "H": [portrait["H"]],
    }
    field, boundary = figure_data.portrait_frames(*cases(scene), coarsest_mesh(scene), *partitions(scene))
    tables.save_csv(field, mesh_path)
    tables.save_csv(boundary, boundary_path)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.portrait, snakemake.output.mesh, snakemake.output.boundary)
