"""The levels of refined meshes, against assembly on each of them; cells on nested levels."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from nested import Nested, assembled, coarse, made, prolongation

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
    return made(name, way, {"at random": 5, "at a node": 8}.get(way))


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
    found = locally(name, way)
    of = found.of
    A = assembled(found.mesh)
    assert len(of.levels) == len(found.meshes) - 1
    assert close(of.A_0, assembled(found.meshes[0]))
    assert close(of.A, A)
    assert np.abs(of.nodal_weights - A.sum(axis=1)).max() < ROUND_OFF
    assert of.A.indices.dtype == np.int32
    for mesh, level in zip(found.meshes[1:-1], of.levels, strict=False):
        nodes, rows = all_rows(level)
        assert level.n == mesh.n_nodes
        assert close(rows, assembled(mesh)[nodes])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("refinements", [0, 1, 3])
def test_coarser_hierarchies_are_those_of_the_coarser_meshes(name: str, refinements: int) -> None:
    found = made(name, "uniform", refinements)
    of: Hierarchy | None = found.of
    for mesh in found.meshes[::-1]:
        assert of is not None
        assert close(of.A, assembled(mesh))
        assert np.abs(of.nodal_weights - assembled(mesh).sum(axis=1)).max() < ROUND_OFF
        assert np.array_equal(of.boundary, mesh.boundary)
        assert np.abs(of.s - mesh.s).max() < ROUND_OFF
        of = of.coarser
    assert of is None


def test_a_moved_node_is_seen_in_the_matrices() -> None:
    found = made("square 3", "uniform", 2)
    points = found.mesh.points.copy()
    points[np.setdiff1d(np.arange(len(points)), found.of.boundary)[0]] += 1e-6
    moved = meshes.from_arrays(found.mesh.polygon, points, found.mesh.triangles)
    assert abs(found.of.A - assembled(moved)).max() > 1e-7


@pytest.mark.parametrize(("name", "way"), ALL)
def test_coarse_matrices_are_galerkins(name: str, way: str) -> None:
    """The nodes whose hats changed are new, or reach new ones; others have the products that they had."""
    found = locally(name, way)
    for (mesh, finer), level in zip(pairwise(found.meshes), found.of.levels, strict=True):
        P = prolongation(level)
        A = assembled(finer)
        before = assembled(mesh)
        assert close(P.T @ A @ P, before)
        assert np.array_equal(P[: level.n_coarse].toarray(), np.eye(level.n_coarse))
        reaching = np.flatnonzero(np.diff(P[level.n_coarse :].tocsc().indptr))
        changed = np.arange(level.n) if level.smoothed_nodes is None else level.smoothed_nodes
        assert np.array_equal(changed, np.append(reaching, np.arange(level.n_coarse, level.n)))
        stay = np.setdiff1d(np.arange(level.n_coarse), reaching)
        assert stay.size == 0 or close(A[stay][:, stay], before[stay][:, stay])


def test_only_nodes_whose_hats_changed_have_rows() -> None:
    """At a node nine new ones a level at most: two triangles, and their neighbours'. Control: uniformly."""
    found = locally("square 3", "at a node").of
    assert max(len(level.smoothed_nodes) for level in found.levels) <= 20  # type: ignore[arg-type]
    assert len(made("square 3", "uniform").of.levels[-1].ends) > 20


@pytest.mark.parametrize("way", ["uniform", *LOCAL])
def test_functionals_and_functions_move_between_levels_by_P(way: str) -> None:
    found = locally("gmsh", way)
    rng = np.random.default_rng(2)
    for level in found.of.levels:
        P = prolongation(level)
        R = rng.standard_normal(found.mesh.n_nodes)
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
@pytest.mark.parametrize("known", [0, 1, 2])
def test_known_levels_are_taken_over(way: str, known: int) -> None:
    """And the hierarchy is that which is made at once; the factors of level 0 are the same object."""
    found = locally("slanted", way)
    before = build_hierarchy(found.meshes[known])
    of = build_hierarchy(found.mesh, before)
    assert of.coarse_factors is before.coarse_factors
    if known == 2:
        assert of.levels[0] is before.levels[0]
    for level, expected in zip(of.levels, found.of.levels, strict=True):
        for name in ("ends", "smoothed_nodes", "columns", "area_halvings"):
            np.testing.assert_array_equal(getattr(level, name), getattr(expected, name))
        assert (level.rows is None) == (expected.rows is None) == (level.n == found.mesh.n_nodes)
        if level.rows is not None:
            assert close(level.rows, expected.rows)
    assert close(of.A, found.of.A)
    for name in ("boundary", "triangles", "coarse_triangle", "area_halvings"):
        np.testing.assert_array_equal(getattr(of, name), getattr(found.of, name))
    assert np.abs(of.nodal_weights - found.of.nodal_weights).max() < ROUND_OFF
    assert build_hierarchy(found.mesh, found.of) is found.of


@pytest.mark.parametrize("way", ["uniform", *LOCAL])
def test_triangles_know_where_they_lie_and_how_often_their_areas_were_halved(way: str) -> None:
    found = locally("slanted", way)
    first = found.meshes[0]
    of = found.of
    corners = first.points[first.triangles[of.coarse_triangle]]
    assert np.array_equal(of.triangles, found.mesh.triangulation.nodes)
    edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 2)
    centre = found.mesh.points[found.mesh.triangles].mean(axis=1) - corners[:, 0]
    share = np.linalg.solve(edges, centre[..., None])[..., 0]
    assert np.all((share > 0) & (share.sum(axis=1, keepdims=True) < 1))
    ratio = first.areas[of.coarse_triangle] / found.mesh.areas
    assert np.allclose(ratio, 2.0**of.area_halvings, rtol=1e-9)
    assert of.area_halvings.max() >= 6


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


def partition_of(of: Hierarchy, polygon: Polygon, every: int) -> Partition:
    """Cells of that many edges; of 3, 2 and 3 in turn for 0."""
    number = np.arange(len(of.s))
    chosen = number % every == 0 if every else np.isin(number % 8, [0, 3, 5])
    return Partition(polygon, of.s[chosen])


def cells_of(name: str, refinements: int, every: int, free: tuple[int, ...] = ()) -> list[LevelCells]:
    found = made(name, "uniform", refinements)
    levels = replace(found.of, form=Form(free=free))
    cells = nested_cells(levels, partition_of(found.of, found.mesh.polygon, every))
    assert cells is not None
    return cells


@pytest.mark.parametrize(
    ("name", "every"),
    [("square 3", 2), ("square 3", 3), ("square 3", 4), ("square 3", 0), ("slanted", 6), ("slanted", 2)],
)
def test_cells_are_unions_with_at_least_two_edges_and_B_is_the_coupling(name: str, every: int) -> None:
    found = made(name, "uniform")
    cells = cells_of(name, 3, every)
    expected = coupling(found.mesh, partition_of(found.of, found.mesh.polygon, every)).toarray()
    assert np.abs(cells[-1].B[:, found.of.boundary].toarray() - expected).max() < ROUND_OFF
    assert cells[-1].B[0, found.of.boundary[0]] != 0
    assert len(cells) > 1
    for fine, coarser, level in zip(cells[:0:-1], cells[-2::-1], found.of.levels[::-1], strict=False):
        assert fine.parent is not None
        sums = np.zeros((len(coarser.inner_node), level.n))
        np.add.at(sums, fine.parent, fine.B.toarray())
        assert np.abs(sums @ prolongation(level) - coarser.B.toarray()).max() < ROUND_OFF
        assert np.allclose(np.bincount(fine.parent, fine.lengths), coarser.lengths, rtol=1e-12, atol=0)
    for each in cells:
        assert np.diff(each.B.indptr).min() >= 3
        assert_inside(each)


def assert_inside(cells: LevelCells) -> None:
    """The node inside belongs to its own cell only."""
    assert np.array_equal((cells.B != 0).sum(axis=0)[cells.inner_node], np.ones(len(cells.inner_node)))


def pairs_of_edges(way: str) -> tuple[Nested, Partition]:
    """Cells of two edges, or of three at the end of a side, on a mesh refined in that way."""
    found = locally("slanted", way)
    count = np.bincount(found.mesh.side)
    starts = np.cumsum(count) - count
    first = [start + np.arange(0, n - 1, 2) for start, n in zip(starts, count, strict=True)]
    return found, Partition(found.mesh.polygon, found.mesh.s[np.append(np.concatenate(first), -1)])


def that_follow(name: str) -> tuple[Nested, Partition]:
    """The cells of an adapted mesh, whose edges are of several lengths, refined at a node of the boundary."""
    of = start_adapted_mesh(coarse(name))
    for _ in range(12):
        of = refine_and_balance(of, np.flatnonzero((of.mesh.triangles == 0).any(axis=1)))
    return Nested([of.mesh], build_hierarchy(of.mesh)), of.partition


@pytest.mark.parametrize("given", [*LOCAL, "square 2", "slanted"])
def test_cells_of_adapted_meshes(given: str) -> None:
    """The node inside has the longest edges. Only the last level has cells."""
    found, partition = pairs_of_edges(given) if given in LOCAL else that_follow(given)
    of = found.of
    mesh = found.mesh
    cells = nested_cells(of, partition)
    assert cells is not None
    (last,) = cells
    assert np.abs(last.B[:, of.boundary].toarray() - coupling(mesh, partition).toarray()).max() < ROUND_OFF
    assert_inside(last)
    both = np.diff(mesh.s) + np.roll(np.diff(mesh.s), 1)
    for row, node in zip(last.B.toarray(), last.inner_node, strict=True):
        own = np.flatnonzero((row > 0)[of.boundary])
        own = own[(last.B != 0).sum(axis=0)[of.boundary[own]] == 1]
        place = np.flatnonzero(of.boundary == node)[0]
        assert both[place] == pytest.approx(both[own].max(), rel=1e-12)


def test_free_sides_have_no_cells() -> None:
    found = made("square 3", "uniform", 2)
    every = cells_of("square 3", 2, 2)
    some = cells_of("square 3", 2, 2, (0, 2))
    assert len(some[-1].inner_node) == len(every[-1].inner_node) / 2
    on_free = found.of.boundary[1:12]
    assert some[-1].B[:, on_free].nnz == 0
    assert every[-1].B[:, on_free].nnz > 0
    assert [len(each.inner_node) for each in cells_of("square 3", 2, 2, (0, 1, 2, 3))] == [0, 0, 0]


def test_partitions_that_the_levels_cannot_follow_are_declined() -> None:
    levels = made("square 3", "uniform", 2).of
    polygon = square()
    s = levels.s
    assert nested_cells(levels, Partition(polygon, s[::2].copy())) is not None
    assert nested_cells(levels, Partition(polygon, s.copy())) is None  # one edge per cell
    assert nested_cells(levels, partitions.make_uniform_partition(polygon, 1 / 5)) is None  # no nodes
    moved = s[::2].copy()
    moved[1] += 1e-9
    assert nested_cells(levels, Partition(polygon, moved)) is None
    moved[1] += 1e-15 - 1e-9
    assert nested_cells(levels, Partition(polygon, moved)) is not None


@pytest.mark.parametrize("form", [Form(), Form(clamped=(3,)), Form(c=0.0, clamped=(3,), friedrichs=2.0)])
def test_the_level_before_is_the_hierarchy_of_its_mesh(form: Form) -> None:
    """The same matrix, sums of rows and masses as without the last step, but for masses at fixed nodes.

    Functions vanish there, and masses there are smaller.
    """
    before = meshes.refine_uniformly(coarse("square 3"), 1)
    found = build_hierarchy(meshes.refine_uniformly(before), form=form).coarser
    wanted = build_hierarchy(before, form=form)
    assert found is not None
    assert close(found.A, wanted.A)
    assert np.abs(found.row_sums - wanted.row_sums).max() < ROUND_OFF
    assert np.abs(found.nodal_weights - wanted.nodal_weights)[~wanted.clamped_nodes].max() < ROUND_OFF
    assert np.all(found.nodal_weights <= wanted.nodal_weights * (1 + ROUND_OFF))
    assert np.array_equal(found.clamped_nodes, wanted.clamped_nodes)
    assert np.array_equal(found.boundary, wanted.boundary)
    assert np.array_equal(found.s, wanted.s)
