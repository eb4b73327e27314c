"""Refinement without sorting, against the checks of meshes and against squares that are made at once."""

import numpy as np
import pytest

from unilateral.geometry import structured as squares
from unilateral.geometry.mesh import from_arrays, refine, unstructured
from unilateral.geometry.polygon import Polygon, named
from unilateral.geometry.refinement import triangulation, turned
from unilateral.geometry.structured import structured

SLANTED = Polygon(np.array([[0, 0], [3, 1], [2.5, 2], [4, 4], [0.5, 3]]), "slanted")
COARSE = {
    "squares": lambda: structured(named("lshape"), 1 / 3),
    "gmsh": lambda: unstructured(SLANTED, 0.7),
}


@pytest.mark.parametrize("name", COARSE)
def test_a_refined_mesh_is_a_triangulation_with_its_boundary_in_order(name):
    """`from_arrays` sorts all edges, and finds the boundary by their places."""
    coarse = COARSE[name]()
    mesh = refine(coarse, 3)
    checked = from_arrays(mesh.polygon, mesh.points, mesh.triangles)
    np.testing.assert_array_equal(checked.boundary, mesh.boundary)
    np.testing.assert_allclose(checked.s, mesh.s, atol=1e-14)
    np.testing.assert_array_equal(mesh.points[: coarse.n_nodes], coarse.points)
    assert mesh.halvings == coarse.halvings + 3


@pytest.mark.parametrize("name", COARSE)
def test_children_have_the_edges_that_sorting_finds(name):
    mesh = refine(COARSE[name](), 2)
    found, sorted_ = mesh.triangulation, triangulation(mesh.points, mesh.triangles, mesh.boundary)
    assert found.inside == sorted_.inside
    for of in (found, sorted_):
        opposite = of.nodes[:, [[1, 2], [2, 0], [0, 1]]]
        np.testing.assert_array_equal(np.sort(of.ends[of.edges], axis=2), np.sort(opposite, axis=2))
        np.testing.assert_array_equal(of.ends[of.inside :, 0], mesh.boundary)
        np.testing.assert_array_equal(of.ends[of.inside :, 1], np.roll(mesh.boundary, -1))
    numbers = np.sort(found.ends[: found.inside], axis=1) @ [mesh.n_nodes, 1]
    np.testing.assert_array_equal(np.sort(numbers), np.sort(sorted_.ends[: found.inside] @ [mesh.n_nodes, 1]))


def test_sums_over_edges_count_their_triangles():
    of = structured(named("lshape"), 1 / 4).triangulation
    meeting = of.sums(np.ones((len(of.nodes), 1)))
    assert np.all(meeting[: of.inside] == 2)
    assert np.all(meeting[of.inside :] == 1)


@pytest.mark.parametrize(("n", "coarsest"), [(1, 1), (6, 3), (7, 7), (8, 4), (20, 5), (24, 3)])
def test_halved_squares_are_finer_squares(n, coarsest):
    halved, at_once = structured(named("lshape"), 1 / n), squares._squares(named("lshape"), n)
    assert len((halved.coarse or halved).triangles) == 6 * coarsest**2
    np.testing.assert_allclose(*(sorted_corners(mesh) for mesh in (halved, at_once)), atol=1e-15)


def sorted_corners(mesh):
    """Triangles by their corners' places, in an order of their own."""
    places = np.round(mesh.points * 840).astype(int)[mesh.triangles]  # whole numbers, for all these n
    keys = np.sort(places @ [1, 10_000], axis=1)
    order = np.lexsort(keys.T)
    return np.sort(mesh.points[mesh.triangles[order]].sum(axis=2), axis=1)


def test_a_triangle_of_another_size_is_not_alike():
    points = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1.0]])
    assert turned(points, np.array([[0, 1, 2], [4, 2, 1]]))[1]
    assert not turned(points, np.array([[0, 1, 2], [0, 3, 2]]))[1]


def test_corners_of_squares_are_turned_until_all_are_alike():
    mesh = structured(named("lshape"), 1 / 3)
    shuffled = np.array([np.roll(corners, k) for k, corners in enumerate(mesh.triangles)])
    found, alike = turned(mesh.points, shuffled)
    assert alike
    sides = np.roll(mesh.points[found], -1, axis=1) - mesh.points[found]
    np.testing.assert_allclose(np.abs(sides), np.broadcast_to(np.abs(sides[0]), sides.shape), atol=1e-15)
