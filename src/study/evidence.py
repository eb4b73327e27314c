"""What a check finds for or against a claim, and what checks share."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterable, Mapping, Sequence
from string import Formatter
from typing import NamedTuple

import numpy as np
import xarray as xr

from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import find_polygon
from unilateral.norms.dual import Gram

Tables = Mapping[str, xr.Dataset]
MAX_ALGEBRAIC_SHARE = 0.01
"""The algebraic error may be at most this share of the error that is judged."""


class Unjudged(Exception):
    """The reason why a claim is not judged: there is nothing to judge, or a precondition does not hold."""


class Evidence(NamedTuple):
    """What is observed and what it has to reach (`is_minimum`) or to stay below; `lines` are its numbers."""

    quantity: str
    observed: float
    required: float
    is_minimum: bool
    lines: list[str]

    @property
    def margin(self) -> float:
        """By how much the requirement is met, relative to what is required unless that is 0."""
        slack = self.observed - self.required
        slack = (slack if self.is_minimum else -slack) + 0.0  # no -0.0
        return slack / abs(self.required) if self.required else slack

    @property
    def holds(self) -> bool:
        """Whether the requirement is met."""
        return self.margin >= 0


def pick_worst(values: Mapping[str, float], quantity: str, required: float, is_minimum: bool) -> Evidence:
    """The worst of named values. Raises Unjudged if there are no values, or one is unknown (NaN)."""
    if not values:
        raise Unjudged(f"there is nothing of which to find {quantity}")
    if unknown := [name for name, value in values.items() if np.isnan(value)]:
        raise Unjudged(f"{quantity} is not known of {'; '.join(unknown)}")
    lines = [f"  {name}: {value:.4g}" for name, value in values.items()]
    observed = (min if is_minimum else max)(values.values())
    return Evidence(quantity, float(observed), required, is_minimum, lines)


def name_values(values: xr.DataArray, name_format: str, scene: str = "") -> dict[str, float]:
    """Values by names, made by a format of the scene and of coordinates, such as "{scene}, H = {H:g}"."""
    dims = named_dimensions(values, name_format)
    named = {}
    for place in itertools.product(*(range(values.sizes[dim]) for dim in dims)):
        value = values.isel(dict(zip(dims, place, strict=True)))
        labels = {name: value[name].item() for name in _format_coordinates(name_format)}
        named[name_format.format(scene=scene, **labels)] = float(value)
    return named


def named_dimensions(values: xr.DataArray, name_format: str) -> list[Hashable]:
    """The dimensions of the coordinates in a format of names."""
    return list(dict.fromkeys(dim for name in _format_coordinates(name_format) for dim in values[name].dims))


def _format_coordinates(name_format: str) -> list[str]:
    return [name for _, name, _, _ in Formatter().parse(name_format) if name and name != "scene"]


def require_all(*evidences: Evidence) -> Evidence:
    """The evidence for a statement in parts: the first part that fails or, if all hold, the first part."""
    return next((evidence for evidence in evidences if not evidence.holds), evidences[0])


def require_preconditions(evidence: Evidence, faults: Sequence[str]) -> Evidence:
    """The evidence. Raises Unjudged if it would pass, but there are faults in what it rests on."""
    if evidence.holds and faults:
        raise Unjudged("; ".join(faults))
    return evidence


def select_cases(
    tables: Tables, table: str, scenes: Sequence[str], cases: Iterable[str]
) -> dict[str, xr.Dataset]:
    """The part of each scene's table about each of these cases that it has, by "scene, case"."""
    by_scene = {scene: tables[table.format(scene=scene)] for scene in scenes}
    return {
        f"{scene}, {case}": data.sel(case=case)
        for scene, data in by_scene.items()
        for case in sorted(set(cases) & set(data["case"].values))
    }


def dual_norm_forms(tables: Tables, scene: str) -> list[tuple[Partition, Gram]]:
    """The partitions of a scene on which the dual norm is known, with its forms there."""
    gram = Gram.from_table(tables[f"{scene}/dual_norm"])
    table = tables[f"{scene}/errors"]
    polygon = find_polygon(str(tables[f"{scene}/dual_norm"]["polygon"].values))
    partitions = [make_uniform_partition(polygon, H) for H in table["H"].values]
    return [
        (partition, gram.coarsen(partition)) for partition in partitions if partition.n_cells <= gram.n_cells
    ]
