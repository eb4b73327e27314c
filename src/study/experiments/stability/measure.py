"""beta over families of meshes and partitions: the table behind Lemma 3.1's condition on h/H."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import eigh

from study.experiments.stability.families import Spec, meshes_of, partition_of
from study.stability_constants import OF_PAIR, constants
from study.tables import save
from unilateral.arrays import Array, Index
from unilateral.fem.condense import condense
from unilateral.fem.spaces import SINGULAR, mixed_spaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.norms.dual import Bracket, dual_norm

Grams = dict[tuple[bytes, bytes], Bracket]
"""The lower and the upper Gram matrix of P0, by the vertices of the polygon and the points of T_H."""
TIE = 1e-3
"""Symmetry classes count as equally bad if the relative difference of their beta^2 is at most this."""


def survey_infsup(
    study: Mapping[str, Any], finds: Mapping[str, Sequence[Spec]], tables: Sequence[str]
) -> None:
    """Write the tables of all families in `study`; `finds` are the pairs of those of kind worst."""
    grams: Grams = {}
    for (name, family), path in zip(study.items(), tables, strict=True):
        parameters = {f"surveys.{name}": family}
        if name in finds:
            parameters[f"finds.{name}"] = finds[name]
        table = survey(*pairs(name, family, finds.get(name, ())), grams)
        save(table, path, name, parameters)
        print(f"{name} measured")


def pairs(
    name: str, family: Mapping[str, Any], finds: Sequence[Spec] = ()
) -> tuple[list[Partition], list[Spec], Sequence[object]]:
    """The partitions of a family, the mappings of their meshes, and the sizes of these."""
    if finds:
        domains = [domain_of(find["polygon"], name) for find in finds]
        specs = [{"points": find["points"]} for find in finds]
        cells = [partition_of(domain, spec) for domain, spec in zip(domains, specs, strict=True)]
        return cells, [{"nodes": find["nodes"]} for find in finds], [1]
    domain = domain_of(family["polygon"], name)
    cells = [partition_of(domain, spec) for spec in family["partitions"]]
    return cells, [family["mesh"]] * len(cells), family.get("deltas") or family["edges_per_cell"]


def domain_of(polygon: Any, name: str) -> Polygon:
    """The polygon of that name, or that with these vertices, which then gets the `name` of its survey."""
    return named(polygon) if isinstance(polygon, str) else Polygon(polygon, name)


def survey(
    partitions: Sequence[Partition], meshes: Sequence[Spec], sizes: Sequence[object], grams: Grams
) -> xr.Dataset:
    """The constants of (3.4) for partitions, on meshes of these sizes against their cells.

    `meshes` holds the mapping of `families` that makes each partition's meshes; a size is the number of
    boundary edges in a cell or, of inner nodes, delta. `grams` keeps the Gram matrices of partitions, so that
    other families may have partitions that are alike. The dimension `mesh` counts the sizes. A mesh that
    several partitions have is condensed once. `worst` is the worst multiplier, NaN where beta = 0 on more
    than one of them; `side` the side of each cell.
    """
    shape = (len(sizes), len(partitions))
    longest = max(partition.n_cells for partition in partitions)
    values = {name: np.full(shape, np.nan) for name in OF_PAIR}
    worst = np.full((*shape, longest), np.nan)
    points = np.full((len(partitions), longest + 1), np.nan)
    side = np.full((len(partitions), longest), np.nan)
    for p, partition in enumerate(partitions):
        points[p, : len(partition.points)] = partition.points
        side[p, : partition.n_cells] = partition.side
    for k, size in enumerate(sizes):
        condensed = cache(condense)
        on = meshes_of(partitions, meshes, size)
        for p, (partition, mesh) in enumerate(zip(partitions, on, strict=True)):
            alike = partition.polygon.vertices.tobytes(), partition.points.tobytes()
            if alike not in grams:
                grams[alike] = dual_norm(partition).gram().p0
            gram = grams[alike]
            spaces = mixed_spaces(condensed(mesh), partition)
            operator = spaces.operator
            sizes_of = {"h": mesh.h, "h_over_H": mesh.h / partition.H}
            for name, value in (sizes_of | constants(spaces, gram)).items():
                values[name][k, p] = value
            if np.count_nonzero(operator.spectrum <= SINGULAR * operator.lambda_max) <= 1:
                symmetries = _symmetries(mesh, partition, meshes[p])
                worst[k, p, : partition.n_cells] = worst_multiplier(operator.D, gram.lower, symmetries)
    pair = ("mesh", "partition")
    table: dict[str, Any] = {name: (pair, value) for name, value in values.items()}
    table |= {"worst": ((*pair, "cell"), worst), "side": (("partition", "cell"), side)}
    table |= {"points": (("partition", "point"), points)}
    H = [partition.H for partition in partitions]
    regularity = [partition.H_over_Hi_max for partition in partitions]
    return xr.Dataset(table, coords={"H": ("partition", H), "H_over_Hi_max": ("partition", regularity)})


def _symmetries(mesh: Mesh, partition: Partition, spec: Spec) -> list[Index]:
    """Half a turn, and x and y exchanged, on a structured mesh and uniform cells of the square; else none."""
    is_square = np.array_equal(mesh.polygon.vertices, square().vertices)
    uniform = np.ptp(partition.lengths) <= 1e-12 * partition.H
    if not (is_square and uniform and spec.get("kind") == "structured"):
        return []
    m = partition.n_cells
    return [np.roll(np.arange(m), -(m // 2)), np.arange(m)[::-1]]


def worst_multiplier(D: Array, G: Array, symmetries: Sequence[Index] = ()) -> Array:
    """mu (m,) at which ||mu||_{-1/2,h} / ||mu||_{-1/2} is smallest, its largest value 1.

    `symmetries` are commuting involutions (m,) of the cells that map the domain, its mesh and T_H onto
    themselves. The worst mu is looked for among those that each symmetry keeps or turns into -mu; of classes
    that are equally bad it is the first, beginning with the symmetric.
    """
    m = len(D)
    least, mu = 0.0, np.empty(0)
    for signs in product((1.0, -1.0), repeat=len(symmetries)):
        projector = np.eye(m)
        for sign, image in zip(signs, symmetries, strict=True):
            projector = 0.5 * (projector + sign * projector[image])
        values, vectors = np.linalg.eigh(projector)
        basis = vectors[:, values > 0.5]
        if not basis.shape[1]:
            continue
        value, x = eigh(basis.T @ D @ basis, basis.T @ G @ basis, subset_by_index=[0, 0])
        if not mu.size or value[0] < least - TIE * abs(least):
            least, mu = float(value[0]), basis @ x[:, 0]
    size = np.abs(mu)
    return mu / mu[np.flatnonzero(size >= (1 - TIE) * size.max())[0]]
