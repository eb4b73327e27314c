"""beta on a family of meshes and partitions."""

from job import run

from unilateral.geometry.polygon import Polygon, named
from unilateral.study import tables
from unilateral.study.runs.families import partition_of
from unilateral.study.runs.stability import survey


def main(study, finds, name, infsup):
    where = study["polygon"]
    domain = named(where) if isinstance(where, str) else Polygon(where, name)
    if finds:
        cells = [partition_of(domain, {"points": find["points"]}) for find in finds]
        table = survey(cells, [{"nodes": find["nodes"]} for find in finds], [1])
    else:
        cells = [partition_of(domain, spec) for spec in study["partitions"]]
        sizes = study.get("deltas") or study["edges_per_cell"]
        table = survey(cells, [study["mesh"]] * len(cells), sizes)
    tables.save(table, infsup, name, {f"surveys.{name}": study} | ({"finds": finds} if finds else {}))


if __name__ == "__main__":
    run(main, snakemake)
