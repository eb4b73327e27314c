"""What the abstract bounds of section 4 are made of: forms of the dual norm, and means of the gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import xarray as xr

from study import scenes, tables
from unilateral.geometry.partition import Partition, common_refinement
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import ExactSolution


def tabulate_dual_forms(partition: Partition, cases: Sequence[ExactSolution]) -> xr.Dataset:
    """The forms that bound ||.||_{-1/2}, see `Gram`, and the cell means of u - g, (case, cell)."""
    forms = build_dual_norm(partition, cases).gram(cases).table(cases)
    gaps = [cell_means(case, partition).gap_means for case in cases]
    return forms.assign(gap_means=(("case", "cell"), gaps))


def measure_dual_norm(scene: Mapping[str, Any], name: str, dual_norm: str) -> None:
    """Write the forms of a scene on the common refinement of the partitions on which the norm is measured."""
    partitions = scenes.scene_partitions(scene)
    finest = common_refinement([partitions[k] for k in scenes.dual_norm_partitions(scene)])
    tables.save_table(
        tabulate_dual_forms(finest, scenes.load_cases(scene)), dual_norm, name, {f"scenes.{name}": scene}
    )
