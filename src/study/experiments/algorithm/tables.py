"""The tables of Uzawa's algorithm: on one mesh, and what its steps cost on several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from study import scenes, tables
from study.experiments.algorithm import measure
from study.experiments.algorithm.formulation import measure_formulation as statements
from unilateral.formulas.formula import parse_real
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.structured import make_structured_mesh


def try_algorithm(
    study: Mapping[str, Any],
    steps: str,
    certificates: str,
    singular: str,
    uniqueness: str,
    unique: str,
    elimination: str,
    split: str,
    formulation: str,
) -> None:
    """Write all of them. Those of two files differ in H: that of the configuration, and h, where beta = 0."""
    polygon = scenes.scene_polygon(study)
    cases = scenes.load_cases(study)
    h = parse_real(study["h"], "algorithm.h")
    H = parse_real(study["H"], "algorithm.H")
    mesh = make_structured_mesh(polygon, h)
    partition = make_uniform_partition(polygon, H)
    finest_partition = make_uniform_partition(polygon, h)
    shares = [float(share) for share in study["shares"]]
    recorded = study["recorded_steps"]
    sizes = [parse_real(size, "algorithm.eliminated") for size in study["eliminated"]]
    meshes = [make_structured_mesh(polygon, size) for size in sizes]
    partitions = [make_uniform_partition(polygon, size * H / h) for size in sizes]
    tables_by_path = {
        steps: measure.measure_algorithm(mesh, partition, cases, shares, study["steps"]),
        certificates: measure.measure_certificates(mesh, partition, cases, recorded),
        singular: measure.measure_certificates(mesh, finest_partition, cases, recorded),
        uniqueness: measure.measure_uniqueness(mesh, finest_partition),
        unique: measure.measure_uniqueness(mesh, partition),
        elimination: measure.measure_elimination(meshes, partitions, study["compared_steps"]),
        split: measure.measure_split(mesh, partition, cases),
        formulation: statements(mesh, partition, cases),
    }
    for path, table in tables_by_path.items():
        tables.save_table(table, path, "algorithm", {"algorithm": study})
