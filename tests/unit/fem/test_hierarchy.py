"""The levels of refined meshes, against assembly on each of them; cells on nested levels."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from nested import Nested, assemble_by_elements, coarse, make_mesh_levels, prolongation

from unilateral.fem.form import Form
from unilateral.fem.hierarchy import FinerSpace, Hierarchy, build_hierarchy
from unilateral.fem.nested_cells import LevelCells, nested_cells
from unilateral.fem.p1 import coupling
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.adapted import refine_and_balance, start_adapted_mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon, square

ROUND_OFF = 1e-12
"""Entries are about 1; coordinates are rounded by 1e-16, and shortest edges and heights are about 1e-2."""
LOCAL = ["at random", "at a node", "mixed"]
NAMES = ["square 1", "square 3", "lshape 2", "gmsh", "slanted", "flat"]
ALL = [(name, way) for name in NAMES for way in ("uniform", *LOCAL)]


def locally(name: str, way: str) -> Nested:
    """Refined eight times at a node, and five times at random."""
    return make_mesh_levels(name, way, {"at random": 5, "at a node": 8}.get(way))


def all_rows(level: FinerSpace) -> tuple[np.ndarray, sp.csr_array]:
    """The nodes, and their rows (s, n), of a level."""
    assert level.rows is not None
    if level.smoothed_nodes is None:
        return np.arange(level.n), level.rows
    assert level.columns is not None
    rows = level.rows
    shape = (len(level.smoothed_nodes), level.n)
    return level.smoothed_nodes, sp.csr_array(
        (rows.data, level.columns[rows.indices], rows.indptr), shape=shape
    )


def close(A: sp.csr_array, B: sp.csr_array) -> bool:
    """Up to rounding."""
    return bool(abs(A - B).max() < ROUND_OFF)


@pytest.mark.parametrize(("name", "way"), ALL)
def test_rows_are_those_of_the_levels_meshes(name: str, way: str) -> None:
    local = locally(name, way)
    hierarchy = local.hierarchy
    A = assemble_by_elements(local.mesh)
    assert len(hierarchy.levels) == len(local.meshes) - 1
    assert close(hierarchy.A_0, assemble_by_elements(local.meshes[0]))
    assert close(hierarchy.A, A)
    assert np.abs(hierarchy.nodal_weights - A.sum(axis=1)).max() < ROUND_OFF
    assert hierarchy.A.indices.dtype == np.int32
    for mesh, level in zip(local.meshes[1:-1], hierarchy.levels, strict=False):
        nodes, rows = all_rows(level)
        assert level.n == mesh.n_nodes
        assert close(rows, assemble_by_elements(mesh)[nodes])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("refinements", [0, 1, 3])
def test_coarser_hierarchies_are_those_of_the_coarser_meshes(name: str, refinements: int) -> None:
    nested = make_mesh_levels(name, "uniform", refinements)
    hierarchy: Hierarchy | None = nested.hierarchy
    for mesh in nested.meshes[::-1]:
        assert hierarchy is not None
        assert close(hierarchy.A, assemble_by_elements(mesh))
        assert np.abs(hierarchy.nodal_weights - assemble_by_elements(mesh).sum(axis=1)).max() < ROUND_OFF
        assert np.array_equal(hierarchy.boundary, mesh.boundary)
        assert np.abs(hierarchy.s - mesh.s).max() < ROUND_OFF
        hierarchy = hierarchy.coarser
    assert hierarchy is None


def test_a_moved_node_is_seen_in_the_matrices() -> None:
    nested = make_mesh_levels("square 3", "uniform", 2)
    points = nested.mesh.points.copy()
    points[np.setdiff1d(np.arange(len(points)), nested.hierarchy.boundary)[0]] += 1e-6
    shifted = meshes.from_arrays(nested.mesh.polygon, points, nested.mesh.triangles)
    assert abs(nested.hierarchy.A - assemble_by_elements(shifted)).max() > 1e-7


@pytest.mark.parametrize(("name", "way"), ALL)
def test_coarse_matrices_are_galerkins(name: str, way: str) -> None:
    """The nodes whose hats changed are new, or reach new ones; others have the products that they had."""
    local = locally(name, way)
    for (mesh, finer), level in zip(pairwise(local.meshes), local.hierarchy.levels, strict=True):
        P = prolongation(level)
        A = assemble_by_elements(finer)
        before = assemble_by_elements(mesh)
        assert close(P.T @ A @ P, before)
        assert np.array_equal(P[: level.n_coarse].toarray(), np.eye(level.n_coarse))
        reaching = np.flatnonzero(np.diff(P[level.n_coarse :].tocsc().indptr))
        changed = np.arange(level.n) if level.smoothed_nodes is None else level.smoothed_nodes
        assert np.array_equal(changed, np.append(reaching, np.arange(level.n_coarse, level.n)))
        stay = np.setdiff1d(np.arange(level.n_coarse), reaching)
        assert stay.size == 0 or close(A[stay][:, stay], before[stay][:, stay])


def test_only_nodes_whose_hats_changed_have_rows() -> None:
    """At a node nine new ones a level at most: two triangles, and their neighbours'. Control: uniformly."""
    hierarchy = locally("square 3", "at a node").hierarchy
    assert max(len(level.smoothed_nodes) for level in hierarchy.levels) <= 20  # type: ignore[arg-type]
    assert len(make_mesh_levels("square 3", "uniform").hierarchy.levels[-1].ends) > 20


@pytest.mark.parametrize("way", ["uniform", *LOCAL])
def test_functionals_and_functions_move_between_levels_by_P(way: str) -> None:
    local = locally("gmsh", way)
    rng = np.random.default_rng(2)
    for level in local.hierarchy.levels:
        P = prolongation(level)
        R = rng.standard_normal(local.mesh.n_nodes)
        restricted = R.copy()
        prolonged = R.copy()
        level.restrict(restricted)
        assert np.allclose(restricted[: level.n_coarse], P.T @ R[: level.n], rtol=0, atol=1e-13)
        assert np.array_equal(restricted[level.n :], R[level.n :])
        level.prolong(prolonged)
        assert np.allclose(prolonged[: level.n], P @ R[: level.n_coarse], rtol=0, atol=1e-13)
        assert np.array_equal(prolonged[level.n :], R[level.n :])
        assert level.max_summands == np.diff(P.tocsc().indptr).max()


@pytest.mark.parametrize("way", LOCAL)
@pytest.mark.parametrize("expected_value", [0, 1, 2])
def test_known_levels_are_taken_over(way: str, expected_value: int) -> None:
    """And the hierarchy is that which is made at once; the factors of level 0 are the same object."""
    local = locally("slanted", way)
    before = build_hierarchy(local.meshes[expected_value])
    hierarchy = build_hierarchy(local.mesh, before)
    assert hierarchy.coarse_factors is before.coarse_factors
    if expected_value == 2:
        assert hierarchy.levels[0] is before.levels[0]
    for level, expected in zip(hierarchy.levels, local.hierarchy.levels, strict=True):
        for name in ("ends", "smoothed_nodes", "columns", "area_halvings"):
            np.testing.assert_array_equal(getattr(level, name), getattr(expected, name))
        assert (level.rows is None) == (expected.rows is None) == (level.n == local.mesh.n_nodes)
        if level.rows is not None:
            assert close(level.rows, expected.rows)
    assert close(hierarchy.A, local.hierarchy.A)
    for name in ("boundary", "triangles", "coarse_triangle", "area_halvings"):
        np.testing.assert_array_equal(getattr(hierarchy, name), getattr(local.hierarchy, name))
    assert np.abs(hierarchy.nodal_weights - local.hierarchy.nodal_weights).max() < ROUND_OFF
    assert build_hierarchy(local.mesh, local.hierarchy) is local.hierarchy


@pytest.mark.parametrize("way", ["uniform", *LOCAL])
def test_triangles_know_where_they_lie_and_how_often_their_areas_were_halved(way: str) -> None:
    local = locally("slanted", way)
    first = local.meshes[0]
    hierarchy = local.hierarchy
    corners = first.points[first.triangles[hierarchy.coarse_triangle]]
    assert np.array_equal(hierarchy.triangles, local.mesh.triangulation.nodes)
    edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 2)
    centre = local.mesh.points[local.mesh.triangles].mean(axis=1) - corners[:, 0]
    share = np.linalg.solve(edges, centre[..., None])[..., 0]
    assert np.all((share > 0) & (share.sum(axis=1, keepdims=True) < 1))
    ratio = first.areas[hierarchy.coarse_triangle] / local.mesh.areas
    assert np.allclose(ratio, 2.0**hierarchy.area_halvings, rtol=1e-9)
    assert hierarchy.area_halvings.max() >= 6


def test_roundness_is_the_ratio_of_singular_values() -> None:
    """Of the maps from the triangle (0, 0), (1, 0), (0, 1), whose hypotenuse becomes the reference edge."""
    for name in ("slanted", "flat"):
        mesh = coarse(name)
        corners = mesh.points[mesh.triangulation.nodes]
        sigma = np.linalg.svd(np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 2), compute_uv=False)
        assert np.allclose(build_hierarchy(mesh).roundness, sigma[:, 1] / sigma[:, 0], rtol=1e-12, atol=0)
    assert np.array_equal(build_hierarchy(coarse("square 1")).roundness, [1, 1])
    corners = np.array([[0, 0], [1, 0], [0.5, np.sqrt(0.75)]])
    equilateral = meshes.from_arrays(Polygon(corners), corners, [[0, 1, 2]])
    assert np.allclose(build_hierarchy(equilateral).roundness, 1 / np.sqrt(3), rtol=1e-12, atol=0)


def partition_of(hierarchy: Hierarchy, polygon: Polygon, every: int) -> Partition:
    """Cells of that many edges; of 3, 2 and 3 in turn for 0."""
    number = np.arange(len(hierarchy.s))
    chosen = number % every == 0 if every else np.isin(number % 8, [0, 3, 5])
    return Partition(polygon, hierarchy.s[chosen])


def cells_of(name: str, refinements: int, every: int, free: tuple[int, ...] = ()) -> list[LevelCells]:
    nested = make_mesh_levels(name, "uniform", refinements)
    levels = replace(nested.hierarchy, form=Form(free=free))
    cells = nested_cells(levels, partition_of(nested.hierarchy, nested.mesh.polygon, every))
    assert cells is not None
    return cells


@pytest.mark.parametrize(
    ("name", "every"),
    [("square 3", 2), ("square 3", 3), ("square 3", 4), ("square 3", 0), ("slanted", 6), ("slanted", 2)],
)
def test_cells_are_unions_with_at_least_two_edges_and_B_is_the_coupling(name: str, every: int) -> None:
    nested = make_mesh_levels(name, "uniform")
    cells = cells_of(name, 3, every)
    expected = coupling(nested.mesh, partition_of(nested.hierarchy, nested.mesh.polygon, every)).toarray()
    assert np.abs(cells[-1].B[:, nested.hierarchy.boundary].toarray() - expected).max() < ROUND_OFF
    assert cells[-1].B[0, nested.hierarchy.boundary[0]] != 0
    assert len(cells) > 1
    for fine, coarser, level in zip(cells[:0:-1], cells[-2::-1], nested.hierarchy.levels[::-1], strict=False):
        assert fine.parent is not None
        sums = np.zeros((len(coarser.inner_node), level.n))
        np.add.at(sums, fine.parent, fine.B.toarray())
        assert np.abs(sums @ prolongation(level) - coarser.B.toarray()).max() < ROUND_OFF
        assert np.allclose(np.bincount(fine.parent, fine.lengths), coarser.lengths, rtol=1e-12, atol=0)
    for cell in cells:
        assert np.diff(cell.B.indptr).min() >= 3
        assert_inside(cell)


def assert_inside(cells: LevelCells) -> None:
    """The node inside belongs to its own cell only."""
    assert np.array_equal((cells.B != 0).sum(axis=0)[cells.inner_node], np.ones(len(cells.inner_node)))


def pairs_of_edges(way: str) -> tuple[Nested, Partition]:
    """Cells of two edges, or of three at the end of a side, on a mesh refined in that way."""
    local = locally("slanted", way)
    count = np.bincount(local.mesh.side)
    starts = np.cumsum(count) - count
    first = [start + np.arange(0, n - 1, 2) for start, n in zip(starts, count, strict=True)]
    return local, Partition(local.mesh.polygon, local.mesh.s[np.append(np.concatenate(first), -1)])


def that_follow(name: str) -> tuple[Nested, Partition]:
    """The cells of an adapted mesh, whose edges are of several lengths, refined at a node of the boundary."""
    adapted_mesh = start_adapted_mesh(coarse(name))
    for _ in range(12):
        adapted_mesh = refine_and_balance(
            adapted_mesh, np.flatnonzero((adapted_mesh.mesh.triangles == 0).any(axis=1))
        )
    return Nested([adapted_mesh.mesh], build_hierarchy(adapted_mesh.mesh)), adapted_mesh.partition


@pytest.mark.parametrize("text", [*LOCAL, "square 2", "slanted"])
def test_only_the_last_level_of_an_adapted_mesh_has_cells(text: str) -> None:
    """The node inside has the longest edges. Only the last level has cells."""
    nested, partition = pairs_of_edges(text) if text in LOCAL else that_follow(text)
    hierarchy = nested.hierarchy
    mesh = nested.mesh
    cells = nested_cells(hierarchy, partition)
    assert cells is not None
    (last,) = cells
    assert (
        np.abs(last.B[:, hierarchy.boundary].toarray() - coupling(mesh, partition).toarray()).max()
        < ROUND_OFF
    )
    assert_inside(last)
    pair = np.diff(mesh.s) + np.roll(np.diff(mesh.s), 1)
    for row, node in zip(last.B.toarray(), last.inner_node, strict=True):
        original = np.flatnonzero((row > 0)[hierarchy.boundary])
        original = original[(last.B != 0).sum(axis=0)[hierarchy.boundary[original]] == 1]
        place = np.flatnonzero(hierarchy.boundary == node)[0]
        assert pair[place] == pytest.approx(pair[original].max(), rel=1e-12)


def test_free_sides_have_no_cells() -> None:
    nested = make_mesh_levels("square 3", "uniform", 2)
    every = cells_of("square 3", 2, 2)
    some = cells_of("square 3", 2, 2, (0, 2))
    assert len(some[-1].inner_node) == len(every[-1].inner_node) / 2
    on_free = nested.hierarchy.boundary[1:12]
    assert some[-1].B[:, on_free].nnz == 0
    assert every[-1].B[:, on_free].nnz > 0
    assert [len(cell.inner_node) for cell in cells_of("square 3", 2, 2, (0, 1, 2, 3))] == [0, 0, 0]


def test_partitions_that_the_levels_cannot_follow_are_declined() -> None:
    levels = make_mesh_levels("square 3", "uniform", 2).hierarchy
    polygon = square()
    s = levels.s
    assert nested_cells(levels, Partition(polygon, s[::2].copy())) is not None
    assert nested_cells(levels, Partition(polygon, s.copy())) is None  # one edge per cell
    assert nested_cells(levels, partitions.make_uniform_partition(polygon, 1 / 5)) is None  # no nodes
    shifted_s = s[::2].copy()
    shifted_s[1] += 1e-9
    assert nested_cells(levels, Partition(polygon, shifted_s)) is None
    shifted_s[1] += 1e-15 - 1e-9
    assert nested_cells(levels, Partition(polygon, shifted_s)) is not None


@pytest.mark.parametrize("form", [Form(), Form(clamped=(3,)), Form(c=0.0, clamped=(3,), friedrichs=2.0)])
def test_the_level_before_is_the_hierarchy_of_its_mesh(form: Form) -> None:
    """The same matrix, sums of rows and masses as without the last step, but for masses at fixed nodes.

    Functions vanish there, and masses there are smaller.
    """
    before = meshes.refine_uniformly(coarse("square 3"), 1)
    coarser = build_hierarchy(meshes.refine_uniformly(before), form=form).coarser
    expected_hierarchy = build_hierarchy(before, form=form)
    assert coarser is not None
    assert close(coarser.A, expected_hierarchy.A)
    assert np.abs(coarser.row_sums - expected_hierarchy.row_sums).max() < ROUND_OFF
    assert (
        np.abs(coarser.nodal_weights - expected_hierarchy.nodal_weights)[
            ~expected_hierarchy.clamped_nodes
        ].max()
        < ROUND_OFF
    )
    assert np.all(coarser.nodal_weights <= expected_hierarchy.nodal_weights * (1 + ROUND_OFF))
    assert np.array_equal(coarser.clamped_nodes, expected_hierarchy.clamped_nodes)
    assert np.array_equal(coarser.boundary, expected_hierarchy.boundary)
    assert np.array_equal(coarser.s, expected_hierarchy.s)
