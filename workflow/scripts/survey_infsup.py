"""beta on families of meshes and partitions."""

from job import run

from unilateral.geometry.polygon import Polygon, named
from unilateral.study.experiments.stability.families import partition_of
from unilateral.study.experiments.stability.measure import Grams, survey
from unilateral.study.tables import save


def main(study, finds, tables):
    grams = Grams()
    for (name, family), path in zip(study.items(), tables, strict=True):
        of = {"finds": finds} if family["kind"] == "worst" else {}
        found = survey(*pairs(name, family, **of), grams)
        save(found, path, name, {f"surveys.{name}": family} | of)
        print(f"{name} measured")


def pairs(name, family, finds=()):
    """Partitions, their meshes, and the sizes of these."""
    where = family["polygon"]
    domain = named(where) if isinstance(where, str) else Polygon(where, name)
    if finds:
        cells = [partition_of(domain, {"points": find["points"]}) for find in finds]
        return cells, [{"nodes": find["nodes"]} for find in finds], [1]
    cells = [partition_of(domain, spec) for spec in family["partitions"]]
    return cells, [family["mesh"]] * len(cells), family.get("deltas") or family["edges_per_cell"]


if __name__ == "__main__":
    run(main, snakemake)
