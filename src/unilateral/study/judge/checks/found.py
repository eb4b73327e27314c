"""What a check finds, and what checks share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.polygon import named
from unilateral.norms.dual import Gram

Tables = Mapping[str, xr.Dataset]
Array = NDArray[np.float64]
ZERO = 1e-12


class Found(NamedTuple):
    """What is observed and what it has to reach (`at_least`) or to stay below; `lines` are its numbers."""

    quantity: str
    observed: float
    required: float
    at_least: bool
    lines: list[str]


def worst(values: Mapping[str, float], quantity: str, required: float, at_least: bool) -> Found:
    """The worst of named values; NaN if there is none."""
    lines = [f"  {name}: {value:.4g}" for name, value in values.items()]
    found = list(values.values())
    worst = (np.min if at_least else np.max)(found) if found else np.nan
    return Found(quantity, float(worst), required, at_least, lines)


def along_ratio(table: xr.Dataset, variable: str, H_over_h: float) -> Array:
    """(case, level) values along H/h, coarse to fine; without cases (level,)."""
    mesh, partition = np.nonzero(np.isclose(1 / table["h_over_H"].values, H_over_h, rtol=1e-9))
    index = {"mesh": xr.DataArray(mesh, dims="run"), "partition": xr.DataArray(partition, dims="run")}
    return table[variable].isel({d: i for d, i in index.items() if d in table[variable].dims}).values


def forms(tables: Tables, scene: str) -> list[tuple[Partition, Gram]]:
    """The partitions of a scene on which the dual norm is known, with its forms there."""
    gram, table = Gram.of_table(tables[f"{scene}/dual_norm"]), tables[f"{scene}/errors"]
    polygon = named(str(tables[f"{scene}/dual_norm"]["polygon"].values))
    cells = [uniform(polygon, H) for H in table["H"].values]
    return [(each, gram.on(each)) for each in cells if each.n_cells <= gram.n_cells]
