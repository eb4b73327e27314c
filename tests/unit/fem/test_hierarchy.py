"""Refined meshes and inherited matrices, against assembly on the refined mesh; cells on nested levels."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from nested import Nested, refined
from scipy.spatial import Delaunay

from unilateral.fem.hierarchy import Level, roundness
from unilateral.fem.inherited import elements
from unilateral.fem.nested_cells import Cells, nested_cells
from unilateral.fem.p1 import coupling, gradients, stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

ROUND_OFF = 1e-12
"""Entries are about 1; coordinates are rounded by 1e-16, and shortest edges and heights are about 1e-2."""


def scattered(seed: int) -> Mesh:
    """A Delaunay triangulation of random points of a trapezium, with six edges on each side."""
    rng = np.random.default_rng(seed)
    polygon = Polygon(np.array([[0.0, 0.0], [1.3, 0.2], [1.0, 1.1], [0.1, 0.9]]))
    s = polygon.divided(np.full(4, 6))[:-1]
    side = np.repeat(np.arange(4), 6)
    points = [*polygon.at(side, s - polygon.starts[side])]
    for x in rng.uniform([0.1, 0.1], [1.2, 1.0], (300, 2)):
        if np.hypot(*(np.array(points) - x).T).min() > 0.1 and inside(polygon, x):
            points.append(x)
    return meshes.from_arrays(polygon, points, _positive(np.array(points), Delaunay(points).simplices))


def inside(polygon: Polygon, x: np.ndarray) -> bool:
    return bool(np.all((x - polygon.vertices) @ polygon.normals.T * np.eye(4) <= 0))


def _positive(points: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Anticlockwise, without flat triangles along straight sides."""
    a, b, c = np.moveaxis(points[found], 1, 0)
    twice = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    found[twice < 0] = found[twice < 0][:, ::-1]
    return found[np.abs(twice) > 1e-9]


@cache
def coarse(name: str) -> Mesh:
    if name == "scattered":
        return scattered(1)
    if name == "gmsh":
        return meshes.unstructured(named("lshape"), 0.4)
    polygon, n = name.split()
    return structured(named(polygon), 1 / int(n))


COARSE = ["square 1", "square 3", "lshape 2", "gmsh", "scattered"]


@cache
def nested(name: str, refinements: int) -> Nested:
    return refined(coarse(name), refinements)


def assembled(mesh: Mesh) -> np.ndarray:
    stiffness, mass = stiffness_and_mass(mesh)
    return (stiffness + mass).toarray()


@pytest.mark.parametrize("name", COARSE)
@pytest.mark.parametrize("refinements", [0, 1, 3])
def test_inherited_matrices_are_those_of_the_refined_mesh(name: str, refinements: int) -> None:
    found = nested(name, refinements)
    assert len(found.levels) == found.mesh.halvings + 1 > refinements
    for k, level in enumerate(found.levels):
        mesh = meshes.refine(found.mesh.coarse or found.mesh, k)
        assert np.abs(level.A.toarray() - assembled(mesh)).max() < ROUND_OFF
        assert np.array_equal(level.boundary, mesh.boundary)
        assert np.abs(level.s - mesh.s).max() < ROUND_OFF
        assert level.A.indices.dtype == np.int32


def test_a_moved_node_is_seen_in_the_matrices() -> None:
    found = nested("square 3", 2)
    points = found.mesh.points.copy()
    points[np.setdiff1d(np.arange(len(points)), found.levels[-1].boundary)[0]] += 1e-6
    moved = meshes.from_arrays(found.mesh.polygon, points, found.mesh.triangles)
    assert np.abs(found.levels[-1].A.toarray() - assembled(moved)).max() > 1e-7


@pytest.mark.parametrize("name", COARSE)
def test_coarse_matrices_are_galerkins(name: str) -> None:
    levels = nested(name, 3).levels
    for level, finer in pairwise(levels):
        assert abs(finer.P.T @ finer.A @ finer.P - level.A).max() < ROUND_OFF
        assert np.array_equal(finer.P[: level.n].toarray(), np.eye(level.n))


def test_roundness_is_the_ratio_of_singular_values() -> None:
    mesh = coarse("scattered")
    equilateral = np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    to_sides = np.linalg.inv(equilateral[1:] - equilateral[0])
    corners = mesh.points[mesh.triangles]
    maps = to_sides @ (corners[:, 1:] - corners[:, :1])
    sigma = np.linalg.svd(maps, compute_uv=False)
    assert np.allclose(roundness(elements(mesh).stiffness), sigma[:, 1] / sigma[:, 0])
    right = roundness(elements(coarse("square 1")).stiffness)
    assert np.allclose(right, 1 / np.sqrt(3))


def test_roundness_is_summed_over_the_triangles_at_an_edge() -> None:
    levels = nested("square 3", 3).levels
    for coarser, level in pairwise(levels):
        nb = len(coarser.boundary)
        assert np.allclose(level.roundness[:-nb], 2 / np.sqrt(3))
        assert np.allclose(level.roundness[-nb:], 1 / np.sqrt(3))


def test_edges_know_their_stiffness() -> None:
    mesh = coarse("scattered")
    of, slopes, area = elements(mesh), gradients(mesh), mesh.areas
    K = area[:, None, None] * (slopes @ slopes.transpose(0, 2, 1))
    assert not of.of.alike  # else corners are turned
    assert np.allclose(of.stiffness, K[:, [1, 2, 0], [2, 0, 1]])


def partition_of(level: Level, polygon: Polygon, every: int) -> Partition:
    """Cells of that many edges; of 3, 2 and 3 in turn for 0."""
    number = np.arange(len(level.s))
    chosen = number % every == 0 if every else np.isin(number % 8, [0, 3, 5])
    return Partition(polygon, level.s[chosen])


def cells_of(name: str, refinements: int, every: int, free: tuple[int, ...] = ()) -> list[Cells]:
    found = nested(name, refinements)
    cells = nested_cells(found.levels, partition_of(found.levels[-1], found.mesh.polygon, every), free)
    assert cells is not None
    return cells


@pytest.mark.parametrize(
    ("name", "every"), [("square 3", 2), ("square 3", 3), ("square 3", 4), ("scattered", 6)]
)
def test_B_is_the_coupling_of_mesh_and_partition(name: str, every: int) -> None:
    found = nested(name, 3)
    partition = partition_of(found.levels[-1], found.mesh.polygon, every)
    B = cells_of(name, 3, every)[-1].B
    expected = coupling(found.mesh, partition).toarray()
    assert np.abs(B[:, found.levels[-1].boundary].toarray() - expected).max() < ROUND_OFF
    assert B[0, found.levels[-1].boundary[0]] != 0


@pytest.mark.parametrize(("name", "every"), [("square 3", 2), ("square 3", 3), ("square 3", 0), ("gmsh", 2)])
def test_coarse_cells_are_unions_with_at_least_two_edges(name: str, every: int) -> None:
    levels, cells = nested(name, 3).levels, cells_of(name, 3, every)
    assert len(cells) > 1
    for fine, coarser, level in zip(cells[:0:-1], cells[-2::-1], levels[:0:-1], strict=False):
        assert fine.parent is not None
        sums = np.zeros((len(coarser.inside), level.n))
        np.add.at(sums, fine.parent, fine.B.toarray())
        assert np.abs(sums @ level.P - coarser.B.toarray()).max() < ROUND_OFF
        assert np.allclose(np.bincount(fine.parent, fine.lengths), coarser.lengths)
    for each in cells:
        assert np.diff(each.B.indptr).min() >= 3
        # The node inside belongs to its own cell only.
        assert np.array_equal((each.B != 0).sum(axis=0)[each.inside], np.ones(len(each.inside)))


def test_free_sides_have_no_cells() -> None:
    found = nested("square 3", 2)
    every, some = cells_of("square 3", 2, 2), cells_of("square 3", 2, 2, (0, 2))
    assert len(some[-1].inside) == len(every[-1].inside) / 2
    on_free = found.levels[-1].boundary[1:12]
    assert some[-1].B[:, on_free].nnz == 0
    assert every[-1].B[:, on_free].nnz > 0
    assert [len(each.inside) for each in cells_of("square 3", 2, 2, (0, 1, 2, 3))] == [0, 0, 0]


def test_partitions_that_the_levels_cannot_follow_are_declined() -> None:
    levels, polygon = nested("square 3", 2).levels, square()
    s = levels[-1].s
    assert nested_cells(levels, Partition(polygon, s[::2].copy())) is not None
    assert nested_cells(levels, Partition(polygon, s.copy())) is None  # one edge per cell
    assert nested_cells(levels, partitions.uniform(polygon, 1 / 5)) is None  # no nodes
    moved = s[::2].copy()
    moved[1] += 1e-9
    assert nested_cells(levels, Partition(polygon, moved)) is None
    moved[1] += 1e-15 - 1e-9
    assert nested_cells(levels, Partition(polygon, moved)) is not None
