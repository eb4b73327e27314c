"""beta over families of meshes and partitions: the table behind Lemma 3.1's condition on h/H.

The configuration declares both as plain mappings.
A partition is one of {H}, {H, shift}, {H, grading}, {H, spread, seed}, {counts}, {points}. Boundary nodes
are one of {kind: follow}, {kind: equal}, {kind: graded, grading}, {kind: random, spread, seed},
{kind: inner}, {kind: inner, ends}, {kind: inner, seed}, {nodes}; a mesh is one of these or
{kind: structured}. Numbers may be formulas such as 1/16. `config` refuses any other mapping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import eigh

from study.stability_constants import PAIR_CONSTANTS, pair_constants
from study.tables import save_table
from unilateral.arrays import Array, Index
from unilateral.fem.condense import condense
from unilateral.fem.spaces import SINGULAR_EIGENVALUE_RATIO, MixedSpaces, mixed_spaces
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh, triangulate_from_boundary
from unilateral.geometry.partition import (
    Partition,
    from_points,
    make_shifted_partition,
    make_uniform_partition,
)
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import Bracket, build_dual_norm

Spec = Mapping[str, Any]
Counts = NDArray[np.intp]
Grams = dict[tuple[bytes, bytes], Bracket]
"""The lower and the upper Gram matrix of P0, by the vertices of the polygon and the points of T_H."""
TIE_TOLERANCE = 1e-3
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
        table = survey_pairs(*family_pairs(name, family, finds.get(name, ())), grams)
        save_table(table, path, name, parameters)
        print(f"{name} measured")


def family_pairs(
    name: str, family: Mapping[str, Any], finds: Sequence[Spec] = ()
) -> tuple[list[Partition], list[Spec], Sequence[object]]:
    """The partitions of a family, the mappings of their meshes, and the sizes of these."""
    if finds:
        domains = [survey_polygon(find["polygon"], name) for find in finds]
        specs = [{"points": find["points"]} for find in finds]
        cells = [make_partition(domain, spec) for domain, spec in zip(domains, specs, strict=True)]
        return cells, [{"nodes": find["nodes"]} for find in finds], [1]
    domain = survey_polygon(family["polygon"], name)
    cells = [make_partition(domain, spec) for spec in family["partitions"]]
    return cells, [family["mesh"]] * len(cells), family.get("deltas") or family["edges_per_cell"]


def survey_polygon(polygon: Any, name: str) -> Polygon:
    """The polygon of that name, or that with these vertices, which then gets the `name` of its survey."""
    return find_polygon(polygon) if isinstance(polygon, str) else Polygon(polygon, name)


def survey_pairs(
    partitions: Sequence[Partition], meshes: Sequence[Spec], sizes: Sequence[object], grams: Grams
) -> xr.Dataset:
    """The constants of (3.4) for partitions, on meshes of these sizes against their cells.

    `meshes` holds the mapping that makes each partition's meshes; a size is the number of
    boundary edges in a cell or, of inner nodes, delta. `grams` keeps the Gram matrices of partitions, so that
    other families may have partitions that are alike. The dimension `mesh` counts the sizes. A mesh that
    several partitions have is condensed once. `worst` is the worst multiplier, NaN where beta = 0 on more
    than one of them; `side` the side of each cell.
    """
    table = _tabulate_cells(partitions)
    worst = np.full((len(sizes), len(partitions), table.sizes["cell"]), np.nan)
    constants = {name: np.full(worst.shape[:2], np.nan) for name in PAIR_CONSTANTS}
    for k, size in enumerate(sizes):
        condensed = cache(condense)
        for p, mesh in enumerate(make_meshes(partitions, meshes, size)):
            spaces = mixed_spaces(condensed(mesh), partitions[p])
            numbers, mu = _survey_pair(spaces, _find_gram(partitions[p], grams), meshes[p])
            for name, value in numbers.items():
                constants[name][k, p] = value
            worst[k, p, : len(mu)] = mu
    variables: dict[str, Any] = {name: (("mesh", "partition"), values) for name, values in constants.items()}
    return table.assign(variables | {"worst": (("mesh", "partition", "cell"), worst)})


def _tabulate_cells(partitions: Sequence[Partition]) -> xr.Dataset:
    """The sides and the ends of the partitions' cells, NaN beyond a partition's last one, and sizes."""
    longest = max(partition.n_cells for partition in partitions)
    side = np.full((len(partitions), longest), np.nan)
    points = np.full((len(partitions), longest + 1), np.nan)
    for p, partition in enumerate(partitions):
        side[p, : partition.n_cells] = partition.side
        points[p, : len(partition.points)] = partition.points
    H = [partition.H for partition in partitions]
    regularity = [partition.H_over_Hi_max for partition in partitions]
    return xr.Dataset(
        {"side": (("partition", "cell"), side), "points": (("partition", "point"), points)},
        coords={"H": ("partition", H), "H_over_Hi_max": ("partition", regularity)},
    )


def _find_gram(partition: Partition, grams: Grams) -> Bracket:
    """The Gram matrices of P0(T_H), from `grams` or else computed and added to it."""
    gram_key = partition.polygon.vertices.tobytes(), partition.points.tobytes()
    if gram_key not in grams:
        grams[gram_key] = build_dual_norm(partition).gram().p0
    return grams[gram_key]


def _survey_pair(spaces: MixedSpaces, gram: Bracket, mesh_spec: Spec) -> tuple[dict[str, float], Array]:
    """The constants of one pair, and its worst multiplier (m,), NaN where that is not one function."""
    mesh = spaces.mesh
    partition = spaces.partition
    operator = spaces.operator
    numbers = {"h": mesh.h, "h_over_H": mesh.h / partition.H} | pair_constants(spaces, gram)
    # beta = 0 on the kernel of S; where its dimension is above 1 any mu in it is as bad
    if np.count_nonzero(operator.spectrum <= SINGULAR_EIGENVALUE_RATIO * operator.lambda_max) > 1:
        return numbers, np.full(partition.n_cells, np.nan)
    symmetries = _cell_symmetries(mesh, partition, mesh_spec)
    return numbers, worst_multiplier(operator.D, gram.lower, symmetries)


def _cell_symmetries(mesh: Mesh, partition: Partition, spec: Spec) -> list[Index]:
    """Half a turn, and x and y exchanged, on a structured mesh and uniform cells of the square; else none."""
    is_square = np.array_equal(mesh.polygon.vertices, square().vertices)
    equal = np.ptp(partition.lengths) <= 1e-12 * partition.H
    if not (is_square and equal and spec.get("kind") == "structured"):
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
    smallest = 0.0
    mu = np.empty(0)
    for signs in product((1.0, -1.0), repeat=len(symmetries)):
        # The product of (1 +- P) / 2 over the symmetries P projects onto the mu with these signs
        projector = np.eye(m)
        for sign, image in zip(signs, symmetries, strict=True):
            projector = 0.5 * (projector + sign * projector[image])
        values, vectors = np.linalg.eigh(projector)
        basis = vectors[:, values > 0.5]
        if not basis.shape[1]:
            continue
        # The least ||mu||_{-1/2,h}^2 / ||mu||_{-1/2}^2 = mu.D mu / mu.G mu of the class
        value, x = eigh(basis.T @ D @ basis, basis.T @ G @ basis, subset_by_index=[0, 0])
        if not mu.size or value[0] < smallest - TIE_TOLERANCE * abs(smallest):
            smallest = float(value[0])
            mu = basis @ x[:, 0]
    # The sign and the size are those that make the first of the largest values 1
    size = np.abs(mu)
    return mu / mu[np.flatnonzero(size >= (1 - TIE_TOLERANCE) * size.max())[0]]


def make_partition(polygon: Polygon, spec: Spec) -> Partition:
    """The partition T_H of a mapping, with as many cells on each side as the uniform one of that H.

    {H} is uniform. `shift` moves the points inside each side forward by that fraction of a cell. `grading` q
    shortens the pieces towards both ends of a side: point i of n lies at (2 i / n)^q / 2 of it in its first
    half. `spread` draws the cells' lengths, log-uniform in [1, spread] up to a factor for each side. {counts}
    are equal cells for each side, {points} arc lengths.
    Raises InputError for a size, a shift or points that the polygon does not allow.
    """
    if "points" in spec:
        return from_points(polygon, _read_numbers(spec["points"], "partition: points"))
    if "counts" in spec:
        return Partition(polygon, polygon.divided(np.array(spec["counts"], dtype=np.intp)))
    H = parse_real(spec["H"], "partition: H")
    if "shift" in spec:
        return make_shifted_partition(polygon, H, parse_real(spec["shift"], "partition: shift"))
    if "grading" in spec:
        return Partition(polygon, _graded_points(polygon, polygon.counts(H), spec))
    if "spread" in spec:
        return Partition(polygon, _random_points(polygon, polygon.counts(H), spec))
    return make_uniform_partition(polygon, H)


def make_meshes(partitions: Sequence[Partition], specs: Sequence[Spec], size: object) -> list[Mesh]:
    """The mesh of each partition, one object for all of a polygon that have the same boundary nodes.

    {kind: structured}, its h = H / size; or a mesh by gmsh with the boundary nodes of `spec`.
    Raises InputError for nodes that are out of order, or without the vertices.
    """
    by_nodes = cache(triangulate_from_boundary)
    meshes = []
    for partition, spec in zip(partitions, specs, strict=True):
        polygon = partition.polygon
        if spec.get("kind") == "structured":
            meshes.append(make_structured_mesh(polygon, partition.H / parse_real(size, "edges_per_cell")))
        else:
            meshes.append(by_nodes(polygon, tuple(place_boundary_nodes(partition, spec, size).tolist())))
    return meshes


def place_boundary_nodes(partition: Partition, spec: Spec, size: object) -> Array:
    """Arc lengths (nb,) of the mesh nodes on the boundary, as the mapping of a mesh places them.

    `follow` places node j of n as the point j m / n of the partition's, linear between its points, so that
    every cell has the same number of edges; `equal`, `graded` and `random` divide the sides as partitions
    do; {nodes} are arc lengths from 0, the perimeter left out. `inner` puts one node into every cell, at the
    share `size` of it from the end nearer to the middle of the side, and at half of a cell in the middle or
    next to it; with a `seed` at random, that share or more from both ends. The ends of cells are nodes only
    where `ends` says so.
    """
    if "nodes" in spec:
        return _read_numbers(spec["nodes"], "boundary nodes: nodes")
    if spec["kind"] == "inner":
        return _place_inner_nodes(partition, parse_real(size, "deltas"), spec)
    cells = np.bincount(partition.side, minlength=partition.polygon.n_sides)
    counts = np.maximum(1, np.floor(parse_real(size, "edges_per_cell") * cells + 0.5)).astype(np.intp)
    if spec["kind"] == "follow":
        side, index = _number_pieces(counts)
        place = (np.cumsum(cells) - cells)[side] + index * cells[side] / counts[side]
        return np.interp(place, np.arange(partition.n_cells + 1), partition.points)
    divided = {
        "graded": _graded_points,
        "random": _random_points,
        "equal": lambda polygon, n, _: polygon.divided(n),
    }
    return divided[spec["kind"]](partition.polygon, counts, spec)[:-1]


def _place_inner_nodes(partition: Partition, delta: float, spec: Spec) -> Array:
    cells = np.bincount(partition.side)
    side, number = _number_pieces(cells)
    # Twice the distance, in cells, of the cell's middle from that of its side
    beyond = 2 * number + 1 - cells[side]
    share = np.where(np.abs(beyond) <= 1, 0.5, np.where(beyond < 0, 1 - delta, delta))
    if "seed" in spec:
        share = np.random.default_rng(spec["seed"]).uniform(delta, 1 - delta, partition.n_cells)
    nodes = partition.points[:-1] + share * partition.lengths
    return np.union1d(nodes, partition.points[:-1] if spec.get("ends") else partition.polygon.starts[:-1])


def _graded_points(polygon: Polygon, counts: Counts, spec: Spec) -> Array:
    q = parse_real(spec["grading"], "grading")
    (side, index) = _number_pieces(counts)
    t = index / counts[side]
    # (2 t)^q / 2 up to the middle of the side, and its mirror image behind it
    share = np.where(t <= 0.5, 0.5 * (2 * t) ** q, 1 - 0.5 * (2 - 2 * t) ** q)
    return np.append(polygon.starts[side] + polygon.lengths[side] * share, polygon.perimeter)


def _random_points(polygon: Polygon, counts: Counts, spec: Spec) -> Array:
    sizes = parse_real(spec["spread"], "spread") ** np.random.default_rng(spec["seed"]).random(counts.sum())
    side, _ = _number_pieces(counts)
    # The sums of the sizes on each side, from its start, over the side's own
    first = np.cumsum(counts) - counts
    before = np.cumsum(sizes) - sizes
    share = (before - before[first][side]) / np.add.reduceat(sizes, first)[side]
    return np.append(polygon.starts[side] + polygon.lengths[side] * share, polygon.perimeter)


def _number_pieces(counts: Counts) -> tuple[Counts, Counts]:
    """Side of every piece, and its number on that side, (sum(counts),) each."""
    side = np.repeat(np.arange(len(counts)), counts)
    return side, np.arange(len(side)) - (np.cumsum(counts) - counts)[side]


def _read_numbers(numbers: Any, where: str) -> Array:
    return np.array([parse_real(value, where) for value in numbers])
