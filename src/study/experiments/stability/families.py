"""Families of partitions and of boundary nodes, declared as plain mappings as the configuration holds them.

A partition is one of {H}, {H, shift}, {H, grading}, {H, spread, seed}, {counts}, {points}. Boundary nodes
are one of {kind: follow}, {kind: equal}, {kind: graded, grading}, {kind: random, spread, seed},
{kind: inner}, {kind: inner, ends}, {kind: inner, seed}, {nodes}; a mesh is one of these or
{kind: structured}. Numbers may be formulas such as 1/16. `config` refuses any other mapping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unilateral.arrays import Array
from unilateral.formulas.formula import real
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, from_points, shifted, uniform
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import structured

Spec = Mapping[str, Any]
Counts = NDArray[np.intp]


def partition_of(polygon: Polygon, spec: Spec) -> Partition:
    """The partition T_H of a mapping, with as many cells on each side as the uniform one of that H.

    {H} is uniform. `shift` moves the points inside each side forward by that fraction of a cell. `grading` q
    shortens the pieces towards both ends of a side: point i of n lies at (2 i / n)^q / 2 of it in its first
    half. `spread` draws the cells' lengths, log-uniform in [1, spread] up to a factor for each side. {counts}
    are equal cells for each side, {points} arc lengths.
    Raises InputError for a size, a shift or points that the polygon does not allow.
    """
    if "points" in spec:
        return from_points(polygon, _reals(spec["points"], "partition: points"))
    if "counts" in spec:
        return Partition(polygon, polygon.divided(np.array(spec["counts"], dtype=np.intp)))
    H = real(spec["H"], "partition: H")
    if "shift" in spec:
        return shifted(polygon, H, real(spec["shift"], "partition: shift"))
    if "grading" in spec:
        return Partition(polygon, _graded(polygon, polygon.counts(H), spec))
    if "spread" in spec:
        return Partition(polygon, _random(polygon, polygon.counts(H), spec))
    return uniform(polygon, H)


def boundary_nodes(partition: Partition, spec: Spec, size: object) -> Array:
    """(nb,) arc lengths of mesh nodes; a side with m cells has n = max(1, round(size m)) edges, unless inner.

    `follow` places node j of n as the point j m / n of the partition's, linear between its points, so that
    every cell has the same number of edges; `equal`, `graded` and `random` divide the sides as partitions
    do; {nodes} are arc lengths from 0, the perimeter left out. `inner` puts one node into every cell, at the
    share `size` of it from the end nearer to the middle of the side, and at half of a cell in the middle or
    next to it; with a `seed` at random, that share or more from both ends. The ends of cells are nodes only
    where `ends` says so.
    """
    if "nodes" in spec:
        return _reals(spec["nodes"], "boundary nodes: nodes")
    if spec["kind"] == "inner":
        return _inner(partition, real(size, "deltas"), spec)
    cells = np.bincount(partition.side, minlength=partition.polygon.n_sides)
    counts = np.maximum(1, np.floor(real(size, "edges_per_cell") * cells + 0.5)).astype(np.intp)
    if spec["kind"] == "follow":
        return _followed(partition, cells, counts)
    divided = {"graded": _graded, "random": _random, "equal": lambda polygon, n, _: polygon.divided(n)}
    return divided[spec["kind"]](partition.polygon, counts, spec)[:-1]


def meshes_of(partitions: Sequence[Partition], specs: Sequence[Spec], size: object) -> list[Mesh]:
    """The mesh of each partition, one object for all of a polygon that have the same boundary nodes.

    {kind: structured}, its h = H / size; or a mesh by gmsh with the boundary nodes of `spec`.
    Raises InputError for nodes that are out of order, or without the vertices.
    """
    by_nodes, made = cache(meshes.with_boundary), []
    for partition, spec in zip(partitions, specs, strict=True):
        polygon = partition.polygon
        if spec.get("kind") == "structured":
            made.append(structured(polygon, partition.H / real(size, "edges_per_cell")))
        else:
            made.append(by_nodes(polygon, tuple(boundary_nodes(partition, spec, size).tolist())))
    return made


def _followed(partition: Partition, cells: Counts, counts: Counts) -> Array:
    side, index = _indices(counts)
    place = (np.cumsum(cells) - cells)[side] + index * cells[side] / counts[side]
    return np.interp(place, np.arange(partition.n_cells + 1), partition.points)


def _inner(partition: Partition, delta: float, spec: Spec) -> Array:
    cells = np.bincount(partition.side)
    side, number = _indices(cells)
    beyond = 2 * number + 1 - cells[side]
    share = np.where(np.abs(beyond) <= 1, 0.5, np.where(beyond < 0, 1 - delta, delta))
    if "seed" in spec:
        share = np.random.default_rng(spec["seed"]).uniform(delta, 1 - delta, partition.n_cells)
    nodes = partition.points[:-1] + share * partition.lengths
    return np.union1d(nodes, partition.points[:-1] if spec.get("ends") else partition.polygon.starts[:-1])


def _graded(polygon: Polygon, counts: Counts, spec: Spec) -> Array:
    q, (side, index) = real(spec["grading"], "grading"), _indices(counts)
    t = index / counts[side]
    share = np.where(t <= 0.5, 0.5 * (2 * t) ** q, 1 - 0.5 * (2 - 2 * t) ** q)
    return np.append(polygon.starts[side] + polygon.lengths[side] * share, polygon.perimeter)


def _random(polygon: Polygon, counts: Counts, spec: Spec) -> Array:
    sizes = real(spec["spread"], "spread") ** np.random.default_rng(spec["seed"]).random(counts.sum())
    side, _ = _indices(counts)
    first = np.cumsum(counts) - counts
    before = np.cumsum(sizes) - sizes
    share = (before - before[first][side]) / np.add.reduceat(sizes, first)[side]
    return np.append(polygon.starts[side] + polygon.lengths[side] * share, polygon.perimeter)


def _indices(counts: Counts) -> tuple[Counts, Counts]:
    """(sum(counts),) each: the side of every piece and its number on that side."""
    side = np.repeat(np.arange(len(counts)), counts)
    return side, np.arange(len(side)) - (np.cumsum(counts) - counts)[side]


def _reals(given: Any, where: str) -> Array:
    return np.array([real(value, where) for value in given])
