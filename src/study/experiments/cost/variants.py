"""The configurations of the study of cost, and the tables that collect their runs.

There are a base, one field of it varied at a time, and some pairs of fields crossed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from study import tables
from unilateral.formulas.formula import real

REFRESH = 50
"""The refined way makes one of so many products in double precision."""


class Variant(NamedTuple):
    """One configuration. `algebra` is the matrix that a step solves with (A, A_3) or multiplies by (S)."""

    scene: str
    case: str
    H_over_h: float
    algorithm: str
    algebra: str
    precision: str


def plan(study: Mapping[str, Any]) -> list[Variant]:
    """The base, each of its fields varied alone, and some of them crossed; each once, in that order."""

    def variant(changed: Mapping[str, Any]) -> Variant:
        fields = study["base"] | changed
        return Variant(**fields | {"H_over_h": real(fields["H_over_h"], "cost.H_over_h")})

    vary = study["vary"]
    alone = [{name: value} for name, values in vary.items() for value in values]
    together = [
        dict(zip(names, values, strict=True))
        for names in study["cross"]
        for values in itertools.product(*([study["base"][name], *vary[name]] for name in names))
    ]
    return list(dict.fromkeys(variant(changed) for changed in [{}, *alone, *together]))


def collect_cost(
    runs: Sequence[str],
    timed: Sequence[str],
    study: Mapping[str, Any],
    axes: Sequence[Sequence[str]],
    cost: str,
    timings: str,
    factors: Sequence[str],
) -> None:
    """Write the tables from those of the jobs; `factors` are the files of the tables along each of `axes`."""
    planned, given = plan(study), {f"cost.{field}": value for field, value in study.items()}
    table = along_runs([tables.load(path) for path in runs], planned)
    tables.save(table, cost, "cost", given)
    tables.save(along_runs([tables.load(path) for path in timed], planned), timings, "cost", given)
    for fields, path in zip(axes, factors, strict=True):
        tables.save(along(table, planned[0], fields), path, "cost", given)


def along_runs(parts: Sequence[xr.Dataset], variants: Sequence[Variant]) -> xr.Dataset:
    """One table from those of several meshes: by variant, in that order, and from coarse to fine."""
    table = xr.concat(parts, "run", combine_attrs="drop")
    places = {variant: k for k, variant in enumerate(variants)}
    fields = zip(*(table[name].values for name in Variant._fields), strict=True)
    place = np.array([places[Variant(*each)] for each in fields])
    return table.isel(run=np.lexsort((-table["h"].values, place)))


def along(table: xr.Dataset, base: Variant, axes: Sequence[str]) -> xr.Dataset:
    """The runs that differ from the base in these fields only, over them, H and the stopping level."""
    others = [name for name in Variant._fields if name not in axes]
    kept = np.logical_and.reduce([table[name].values == getattr(base, name) for name in others])
    runs = table.isel(run=np.flatnonzero(kept))
    labels = {name: pd.unique(runs[name].values) for name in axes} | {"H": np.unique(runs["H"])[::-1]}
    index = pd.MultiIndex.from_arrays([runs[name].values for name in labels], names=[*labels])
    places = xr.Coordinates.from_pandas_multiindex(index, "run")
    unstacked = runs.drop_vars([*Variant._fields, "H"]).assign_coords(places).unstack("run").reindex(labels)
    variables = unstacked.transpose(*labels, "stop").data_vars.items()
    coords = {**labels, "stop": table["stop"].values}
    return xr.Dataset({name: each.variable for name, each in variables}, coords)
