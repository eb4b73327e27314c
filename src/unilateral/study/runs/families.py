"""Families of partitions and of boundary nodes, declared as plain mappings as a data file holds them.

A partition is one of {H}, {H, shift}, {H, grading}, {H, spread, seed}, {counts}, {points}. Boundary nodes
are one of {kind: follow}, {kind: equal}, {kind: graded, grading}, {kind: random, spread, seed}, {nodes}; a
mesh is one of these or {kind: structured}. Numbers may be formulas such as 1/16.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.formula import real
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, from_points, shifted, uniform
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import structured

Spec = Mapping[str, Any]
Counts = NDArray[np.intp]

PARTITIONS = (("H",), ("H", "shift"), ("H", "grading"), ("H", "spread", "seed"), ("counts",), ("points",))
NODES = {"follow": (), "equal": (), "graded": ("grading",), "random": ("spread", "seed")}


def partition_of(polygon: Polygon, spec: Spec) -> Partition:
    """The partition T_H of a mapping, with as many cells on each side as the uniform one of that H.

    {H} is uniform. `shift` moves the points inside each side forward by that fraction of a cell. `grading` q
    shortens the pieces towards both ends of a side: point i of n lies at (2 i / n)^q / 2 of it in its first
    half. `spread` draws the cells' lengths, log-uniform in [1, spread] up to a factor for each side. {counts}
    are equal cells for each side, {points} arc lengths.
    Raises InputError for any other mapping.
    """
    if not isinstance(spec, Mapping) or not any(set(spec) == set(keys) for keys in PARTITIONS):
        choices = ", ".join("{" + ", ".join(keys) + "}" for keys in PARTITIONS)
        raise InputError(f"partition: {_shown(spec)} is not one of {choices}")
    if "points" in spec:
        return from_points(polygon, _reals(spec["points"], "partition: points"))
    if "counts" in spec:
        return Partition(polygon, polygon.divided(_counts(polygon, spec["counts"])))
    H = real(spec["H"], "partition: H")
    counts = polygon.counts(H)
    if "shift" in spec:
        return shifted(polygon, H, real(spec["shift"], "partition: shift"))
    if "grading" in spec:
        return Partition(polygon, _graded(polygon, counts, _at_least_one(spec, "grading", "partition")))
    if "spread" in spec:
        return Partition(polygon, _random(polygon, counts, spec, "partition"))
    return uniform(polygon, H)


def boundary_nodes(partition: Partition, spec: Spec, edges_per_cell: object) -> Array:
    """(nb,) arc lengths of mesh nodes; a side with m cells has n = max(1, round(edges_per_cell m)) edges.

    `follow` places node j of n as the point j m / n of the partition's, linear between its points, so that
    every cell has the same number of edges; `equal`, `graded` and `random` divide the sides as partitions
    do; {nodes} are arc lengths from 0, the perimeter left out. Raises InputError for any other mapping.
    """
    polygon = partition.polygon
    if isinstance(spec, Mapping) and set(spec) == {"nodes"}:
        return _reals(spec["nodes"], "boundary nodes: nodes")
    kind = spec.get("kind") if isinstance(spec, Mapping) else None
    if kind not in NODES or set(spec) != {"kind", *NODES[kind]}:
        choices = "".join(", ".join((f"{{kind: {k}", *keys)) + "}, " for k, keys in NODES.items())
        raise InputError(f"boundary nodes: {_shown(spec)} is not one of {choices}{{nodes}}")
    K = _edges_per_cell(edges_per_cell)
    cells = np.bincount(partition.side, minlength=polygon.n_sides)
    counts = np.maximum(1, np.floor(K * cells + 0.5)).astype(np.intp)
    if kind == "follow":
        return _followed(partition, cells, counts)
    if kind == "graded":
        return _graded(polygon, counts, _at_least_one(spec, "grading", "boundary nodes"))[:-1]
    if kind == "random":
        return _random(polygon, counts, spec, "boundary nodes")[:-1]
    return polygon.divided(counts)[:-1]


def mesh_of(partition: Partition, spec: Spec, edges_per_cell: object) -> Mesh:
    """{kind: structured}, its h = H / edges_per_cell; or a mesh by gmsh with the boundary nodes of `spec`."""
    if isinstance(spec, Mapping) and dict(spec) == {"kind": "structured"}:
        return structured(partition.polygon, partition.H / _edges_per_cell(edges_per_cell))
    return meshes.with_boundary(partition.polygon, boundary_nodes(partition, spec, edges_per_cell))


def _followed(partition: Partition, cells: Counts, counts: Counts) -> Array:
    side, index = _indices(counts)
    place = (np.cumsum(cells) - cells)[side] + index * cells[side] / counts[side]
    return np.interp(place, np.arange(partition.n_cells + 1), partition.points)


def _graded(polygon: Polygon, counts: Counts, q: float) -> Array:
    side, index = _indices(counts)
    t = index / counts[side]
    share = np.where(t <= 0.5, 0.5 * (2 * t) ** q, 1 - 0.5 * (2 - 2 * t) ** q)
    return np.append(polygon.starts[side] + polygon.lengths[side] * share, polygon.perimeter)


def _random(polygon: Polygon, counts: Counts, spec: Spec, where: str) -> Array:
    spread, seed = _at_least_one(spec, "spread", where), spec["seed"]
    if not isinstance(seed, int) or seed < 0:
        raise InputError(f"{where}: the seed {seed!r} is not a whole number, 0 or more")
    sizes = spread ** np.random.default_rng(seed).random(counts.sum())
    side, _ = _indices(counts)
    first = np.cumsum(counts) - counts
    before = np.cumsum(sizes) - sizes
    share = (before - before[first][side]) / np.add.reduceat(sizes, first)[side]
    return np.append(polygon.starts[side] + polygon.lengths[side] * share, polygon.perimeter)


def _indices(counts: Counts) -> tuple[Counts, Counts]:
    """(sum(counts),) each: the side of every piece and its number on that side."""
    side = np.repeat(np.arange(len(counts)), counts)
    return side, np.arange(len(side)) - (np.cumsum(counts) - counts)[side]


def _counts(polygon: Polygon, given: Any) -> Counts:
    listed = isinstance(given, Sequence) and not isinstance(given, str)
    if not listed or len(given) != polygon.n_sides or not all(isinstance(n, int) and n > 0 for n in given):
        raise InputError(
            f"partition: the counts {_shown(given)} are not {polygon.n_sides} whole numbers, one or more "
            f"cells for each side of polygon '{polygon.name}'"
        )
    return np.array(given, dtype=np.intp)


def _at_least_one(spec: Spec, key: str, where: str) -> float:
    value = real(spec[key], f"{where}: {key}")
    if value < 1:
        raise InputError(f"{where}: the {key} {value:g} is less than 1, with which all pieces are equal")
    return value


def _edges_per_cell(given: object) -> float:
    K = real(given, "edges_per_cell")
    if K <= 0:
        raise InputError(f"edges_per_cell: {K:g} is not positive, as a number of edges has to be")
    return K


def _reals(given: Any, where: str) -> Array:
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise InputError(f"{where}: {_shown(given)} is not a list of arc lengths")
    return np.array([real(value, where) for value in given])


def _shown(given: object) -> str:
    text = str(dict(given)) if isinstance(given, Mapping) else repr(given)
    return text if len(text) <= 80 else text[:77] + "..."
