"""The tables of Uzawa's algorithm: on one mesh, and what its steps cost on several."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from study import scenes, tables
from study.experiments.algorithm import measure
from study.experiments.algorithm.formulation import formulation as statements
from unilateral.formulas.formula import real
from unilateral.geometry.partition import uniform
from unilateral.geometry.structured import structured


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
    polygon = scenes.domain(study)
    cases = scenes.cases(study)
    h = real(study["h"], "algorithm.h")
    H = real(study["H"], "algorithm.H")
    mesh = structured(polygon, h)
    cells = uniform(polygon, H)
    finest = uniform(polygon, h)
    shares = [float(share) for share in study["shares"]]
    recorded = study["recorded_steps"]
    sizes = [real(size, "algorithm.eliminated") for size in study["eliminated"]]
    meshes = [structured(polygon, size) for size in sizes]
    partitions = [uniform(polygon, size * H / h) for size in sizes]
    made = {
        steps: measure.algorithm(mesh, cells, cases, shares, study["steps"]),
        certificates: measure.certificates(mesh, cells, cases, recorded),
        singular: measure.certificates(mesh, finest, cases, recorded),
        uniqueness: measure.uniqueness(mesh, finest),
        unique: measure.uniqueness(mesh, cells),
        elimination: measure.elimination(meshes, partitions, study["compared_steps"]),
        split: measure.split(mesh, cells, cases),
        formulation: statements(mesh, cells, cases),
    }
    for path, table in made.items():
        tables.save(table, path, "algorithm", {"algorithm": study})
