"""beta on a family of meshes and partitions."""

from sentences import speak_plainly

from unilateral.geometry import polygon
from unilateral.study import tables
from unilateral.study.runs import families
from unilateral.study.runs.stability import survey


def main(study, finds, name, path):
    where = study["polygon"]
    domain = polygon.named(where) if isinstance(where, str) else polygon.Polygon(where, name)
    if finds:
        cells = [families.partition_of(domain, {"points": find["points"]}) for find in finds]
        table = survey(cells, [{"nodes": find["nodes"]} for find in finds], [1])
    else:
        cells = [families.partition_of(domain, spec) for spec in study["partitions"]]
        table = survey(cells, [study["mesh"]] * len(cells), study["edges_per_cell"])
    tables.save(table, path, name)


if __name__ == "__main__":
    speak_plainly()
    main(snakemake.params.survey, snakemake.params.finds, snakemake.wildcards.survey, snakemake.output[0])
