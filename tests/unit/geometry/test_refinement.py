"""Refinement without sorting, against the checks of meshes and against squares that are made at once."""

import copy
import pickle
from itertools import pairwise

import numpy as np
import pytest
from nested import coarse, forget_refinement, make_mesh_levels

from unilateral.geometry import structured as squares
from unilateral.geometry.mesh import from_arrays, make_unstructured_mesh, refine_triangles, refine_uniformly
from unilateral.geometry.polygon import find_polygon, square
from unilateral.geometry.refinement import build_triangulation, rotate_corners, rotate_to_pattern
from unilateral.geometry.structured import make_structured_mesh

NAMES = ["lshape 3", "slanted", "flat"]
WAYS = ["uniform", "at random", "at a node"]
ALL = [(name, way) for name in NAMES for way in WAYS]


@pytest.mark.parametrize(("name", "way"), ALL)
def test_a_refined_mesh_is_a_triangulation_with_its_boundary_in_order(name, way):
    """`from_arrays` checks conformity and areas, sorts all edges, and finds the boundary by their places."""
    first, *_, mesh = make_mesh_levels(name, way).meshes
    checked = from_arrays(mesh.polygon, mesh.points, mesh.triangles)
    np.testing.assert_array_equal(checked.boundary, mesh.boundary)
    np.testing.assert_allclose(checked.s, mesh.s, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(mesh.points[: first.n_nodes], first.points)
    assert way != "at a node" or np.ptp(np.log2(np.diff(mesh.s))) > 3
    assert mesh.coarse is first
    assert len(mesh.steps) == len(make_mesh_levels(name, way).meshes) - 1
    assert mesh.is_adapted == (way != "uniform")
    assert mesh.halvings == (3 if way == "uniform" else 0)


@pytest.mark.parametrize(("name", "way"), ALL)
def test_children_have_the_edges_that_sorting_finds(name, way):
    """And the triangles at them, and those along the boundary."""
    for mesh in make_mesh_levels(name, way).meshes[1:]:
        triangulation = mesh.triangulation
        expected = build_triangulation(mesh.points, mesh.triangles, mesh.boundary)
        assert triangulation.n_nodes == mesh.n_nodes
        np.testing.assert_array_equal(triangulation.nodes, mesh.triangles)
        factor = np.lexsort(np.sort(triangulation.ends, axis=1).T[::-1])
        place = np.lexsort(np.sort(expected.ends, axis=1).T[::-1])
        for array in ("ends", "edge_triangles"):
            pair = (
                np.sort(getattr(hierarchy_mesh, array)[index], axis=1)
                for hierarchy_mesh, index in ((triangulation, factor), (expected, place))
            )
            np.testing.assert_array_equal(*pair)
        number = np.empty(len(factor), dtype=int)
        number[place] = factor
        turns = [
            (triangulation.nodes == np.roll(expected.nodes, turn, axis=1)).all(axis=1) for turn in range(3)
        ]
        assert np.all(np.logical_or.reduce(turns))
        for turn, position in enumerate(turns):
            edges = np.roll(number[expected.edges], turn, axis=1)
            np.testing.assert_array_equal(triangulation.edges[position], edges[position])
        np.testing.assert_array_equal(triangulation.boundary_edges, number[expected.boundary_edges])
        check_sides(triangulation)


def check_sides(mesh):
    """The first triangle at an edge has it from its first end to its second; one at the boundary has none."""
    start, end = mesh.ends.T
    for column, (a, b) in enumerate(((start, end), (end, start))):
        there = np.flatnonzero(mesh.edge_triangles[:, column] >= 0)
        nodes = mesh.nodes[mesh.edge_triangles[there, column]]
        edges = mesh.edges[mesh.edge_triangles[there, column]]
        corner = np.argmax(edges == there[:, None], axis=1)
        rows = np.arange(len(there))
        np.testing.assert_array_equal(edges[rows, corner], there)
        np.testing.assert_array_equal(nodes[rows, (corner + 1) % 3], a[there])
        np.testing.assert_array_equal(nodes[rows, (corner + 2) % 3], b[there])
    np.testing.assert_array_equal((mesh.edge_triangles >= 0).sum(axis=1), np.bincount(mesh.edges.ravel()))
    with_one_triangle = np.flatnonzero((mesh.edge_triangles < 0).any(axis=1))
    np.testing.assert_array_equal(np.sort(mesh.boundary_edges), with_one_triangle)


def test_a_mesh_in_another_order_has_other_edges():
    """Control: the comparison sees a wrong number."""
    triangulation = make_mesh_levels("slanted", "at random").mesh.triangulation
    wrong = triangulation.edges.copy()
    wrong[[0, 1]] = wrong[[1, 0]]
    with pytest.raises(AssertionError):
        check_sides(
            type(triangulation)(
                triangulation.n_nodes,
                triangulation.nodes,
                wrong,
                triangulation.ends,
                triangulation.edge_triangles,
                triangulation.boundary_edges,
            )
        )


@pytest.mark.parametrize("name", NAMES)
def test_nodes_triangles_and_edges_that_stay_keep_their_numbers(name):
    """So does the first child its parent's, and the first half of an edge the edge's, from its first end."""
    for before, after in pairwise(make_mesh_levels(name, "at random").meshes):
        old = before.triangulation
        new = after.triangulation
        (*_, step) = after.steps
        T = len(old.nodes)
        E = len(old.ends)
        k = len(step.ends)
        np.testing.assert_array_equal(after.points[: before.n_nodes], before.points)
        np.testing.assert_allclose(
            after.points[before.n_nodes :], before.points[step.ends].mean(axis=1), rtol=0, atol=1e-15
        )
        stay = np.setdiff1d(np.arange(T), step.parent)
        assert stay.size or name == "flat"
        for array in ("nodes", "edges"):
            np.testing.assert_array_equal(getattr(new, array)[stay], getattr(old, array)[stay])
        halved = (new.ends[:E] != old.ends).any(axis=1)
        assert np.count_nonzero(halved) == k
        np.testing.assert_array_equal(new.ends[:E][~halved], old.ends[~halved])
        np.testing.assert_array_equal(step.ends, old.ends[halved])
        np.testing.assert_array_equal(step.edge_triangles, old.edge_triangles[halved])
        np.testing.assert_array_equal(new.ends[:E][halved, 0], old.ends[halved, 0])
        np.testing.assert_array_equal(new.ends[:E][halved, 1], before.n_nodes + np.arange(k))
        np.testing.assert_array_equal(new.ends[E : E + k, 1], old.ends[halved, 1])
        first = step.triangles < T
        np.testing.assert_array_equal(step.triangles[first], step.parent[first])
        np.testing.assert_array_equal(np.sort(step.triangles[~first]), np.arange(T, len(new.nodes)))
        np.testing.assert_array_equal(new.nodes[step.triangles], step.nodes)


@pytest.mark.parametrize(("name", "way"), ALL)
def test_children_fill_their_parents(name, way):
    """Two, three or four of them; their areas add up, and are halves and quarters."""
    for before, after in pairwise(make_mesh_levels(name, way).meshes):
        step = after.steps[-1]
        count = np.bincount(step.parent, minlength=len(before.areas))
        assert set(np.unique(count)) <= {0, 2, 3, 4}
        share = after.areas[step.triangles] / before.areas[step.parent]
        np.testing.assert_allclose(np.bincount(step.parent, share)[np.unique(step.parent)], 1, rtol=1e-9)
        assert np.all(np.isclose(share, 0.5, rtol=1e-9) | np.isclose(share, 0.25, rtol=1e-9))


@pytest.mark.parametrize(("name", "way"), ALL)
def test_in_the_frame_of_the_first_triangle_all_are_right_and_isosceles(name, way):
    """Exactly: in it corners are dyadic numbers. The right angle comes first; so there are few shapes.

    Control: with another corner first it is not so. As one of two shapes, turned by 45 degrees to each other,
    a triangle has at most four times the squared longest edge over area of the first one.
    """
    first, *_, mesh = make_mesh_levels(name, way).meshes
    root = np.arange(len(first.triangles))
    for step in mesh.steps:
        root = step.inherit(root)
    frame = first.points[first.triangles[root]]
    edges = np.moveaxis(frame[:, 1:] - frame[:, :1], 1, 2)
    solution = np.linalg.solve(edges[:, None], (mesh.points[mesh.triangles] - frame[:, :1])[..., None])[
        ..., 0
    ]
    fine = 2.0**20
    near = np.rint(solution * fine) / fine
    assert np.abs(solution - near).max() < 1e-9
    a, b, c = np.moveaxis(near, 1, 0)
    u = b - a
    v = c - a
    assert np.all(np.sum(u * v, axis=1) == 0)
    assert np.all(np.sum(u * u, axis=1) == np.sum(v * v, axis=1))
    assert np.all(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0] > 0)
    assert np.all(np.sum((a - b) * (c - b), axis=1) != 0)
    direction = np.sign(u).astype(int)
    for value in np.unique(root):
        assert len(np.unique(direction[root == value], axis=0)) <= 8
    before = first.longest_edges**2 / first.areas
    after = mesh.longest_edges**2 / mesh.areas
    assert np.all(after <= 4 * (1 + 1e-9) * before[root])


@pytest.mark.parametrize("name", NAMES)
def test_a_uniform_step_gives_four_similar_children(name):
    """Their edges are half of the parent's, in order, and minus half those of the middle child."""
    for before, after in pairwise(make_mesh_levels(name, "uniform").meshes):
        step = after.steps[-1]
        T = len(before.triangles)
        assert step.refined_triangulation is after.triangulation
        assert len(after.triangles) == len(step.triangles) == 4 * T
        np.testing.assert_array_equal(step.parent, np.tile(np.arange(T), 4))
        parents = before.points[before.triangles[step.parent]]
        children = after.points[step.nodes]
        parent_edges = np.roll(parents, -1, axis=1) - parents
        child_edges = np.roll(children, -1, axis=1) - children
        sign = np.repeat([1, 1, 1, -1], T)[:, None, None]
        np.testing.assert_allclose(child_edges, 0.5 * sign * parent_edges, rtol=0, atol=1e-14)


def test_all_triangles_chosen_one_by_one_are_a_uniform_step():
    mesh = coarse("slanted")
    every = refine_uniformly(mesh)
    by_name = refine_triangles(mesh, np.arange(len(mesh.triangles)))
    np.testing.assert_array_equal(every.triangles, by_name.triangles)
    assert not by_name.is_adapted
    but_one = refine_triangles(mesh, np.arange(1, len(mesh.triangles)))
    assert but_one.is_adapted or len(but_one.triangles) == len(every.triangles)


def test_chosen_triangles_are_cut_in_four_and_few_others():
    """Those beside, and what halving of reference edges needs: one chosen triangle of 1000 makes few new."""
    mesh = make_unstructured_mesh(square(), 1 / 20)
    for chosen in range(0, len(mesh.triangles), 97):
        step = refine_triangles(mesh, np.array([chosen])).steps[-1]
        count = np.bincount(step.parent, minlength=len(mesh.triangles))
        assert count[chosen] == 4
        assert len(step.ends) < 40
        assert len(step.triangles) == len(step.nodes) == len(step.parent) == count.sum() < 120
        red = (count == 4) & (np.arange(len(count)) != chosen)
        assert np.all(np.isin(mesh.triangulation.edges[red], edges_of(mesh, step)))


def edges_of(mesh, step):
    """The numbers of the halved edges."""
    keys = np.sort(mesh.triangulation.ends, axis=1) @ [mesh.n_nodes, 1]
    halved = np.sort(step.ends, axis=1) @ [mesh.n_nodes, 1]
    return np.flatnonzero(np.isin(keys, halved))


@pytest.mark.parametrize("way", WAYS)
def test_a_step_s_size_is_that_of_what_is_new(way):
    """However large the mesh is: at a node the same numbers of triangles in every step."""
    for before, after in pairwise(make_mesh_levels("lshape 3", way).meshes):
        step = after.steps[-1]
        new = len(after.triangles) - len(before.triangles)
        assert len(step.ends) == after.n_nodes - before.n_nodes
        assert new < len(step.triangles) == new + len(np.unique(step.parent)) <= 2 * new
        assert step.n_old_nodes == before.n_nodes
        assert step.n_old_triangles == len(before.triangles)
    if way == "at a node":
        assert len({len(step.triangles) for step in after.steps[2:]}) == 1


@pytest.mark.parametrize(("name", "way"), ALL)
def test_values_of_triangles_are_put_in_and_inherited(name, way):
    """Numbers of rows and of triangles: areas, and the first triangle that contains each one."""
    first, *finer = make_mesh_levels(name, way).meshes
    areas = first.areas
    root = np.arange(len(first.areas))
    middle = first.points[first.triangles].mean(axis=1)
    for mesh in finer:
        step = mesh.steps[-1]
        areas = step.replace_values(areas, mesh.areas[step.triangles])
        middle = step.replace_values(middle, mesh.points[step.nodes].mean(axis=1))
        root = step.inherit(root)
        assert len(areas) == len(root) == len(mesh.triangles)
    np.testing.assert_array_equal(areas, mesh.areas)
    np.testing.assert_allclose(middle, mesh.points[mesh.triangles].mean(axis=1), rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.bincount(root, mesh.areas), first.areas, rtol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_reference_edges_are_longest_ones_in_the_beginning(name):
    mesh = coarse(name)
    again = rotate_corners(mesh.points, np.roll(mesh.triangles, 1, axis=1))
    for triangles in (mesh.triangles, again):
        _, b, c = np.moveaxis(mesh.points[triangles], 1, 0)
        np.testing.assert_allclose(np.hypot(*(c - b).T), mesh.longest_edges, rtol=1e-12)
    np.testing.assert_array_equal(np.sort(again, axis=1), np.sort(mesh.triangles, axis=1))


@pytest.mark.parametrize(("n", "coarsest"), [(1, 1), (6, 3), (7, 7), (8, 4), (20, 5), (24, 3)])
def test_halved_squares_are_finer_squares(n, coarsest):
    halved = make_structured_mesh(find_polygon("lshape"), 1 / n)
    at_once = make_at_once(1 / n)
    assert len((halved.coarse or halved).triangles) == 6 * coarsest**2
    np.testing.assert_allclose(*(sorted_corners(mesh) for mesh in (halved, at_once)), rtol=0, atol=1e-15)


def make_at_once(h):
    """The mesh that is not made by halving."""
    lshape = find_polygon("lshape")
    return squares._mesh_rectangles(lshape, squares._make_tensor_grid(lshape, h))


def sorted_corners(mesh):
    """Triangles by their corners' places, in an order of their own."""
    places = np.round(mesh.points * 840).astype(int)[mesh.triangles]  # whole numbers, for all these n
    keys = np.sort(places @ [1, 10_000], axis=1)
    order = np.lexsort(keys.T)
    return np.sort(mesh.points[mesh.triangles[order]].sum(axis=2), axis=1)


def test_triangles_are_alike_in_one_size_and_shape():
    """All are looked at where the first thousand are alike: of 1250 the last one may be of another shape."""
    points = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1.0]])
    assert rotate_to_pattern(points, np.array([[0, 1, 2], [4, 2, 1]]))[1]
    assert not rotate_to_pattern(points, np.array([[0, 1, 2], [0, 3, 2]]))[1]
    mesh = make_structured_mesh(square(), 1 / 25)
    points = mesh.points.copy()
    assert rotate_to_pattern(points, mesh.triangles)[1]
    points[mesh.triangles[-1, 0]] += 1e-3
    assert not rotate_to_pattern(points, mesh.triangles)[1]


def test_corners_of_squares_are_turned_until_all_are_alike():
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 3)
    shuffled = np.array([np.roll(corners, k) for k, corners in enumerate(mesh.triangles)])
    corners, alike = rotate_to_pattern(mesh.points, shuffled)
    assert alike
    sides = np.roll(mesh.points[corners], -1, axis=1) - mesh.points[corners]
    assert np.abs(np.abs(sides) - np.abs(sides[0])).max() <= 1e-15


def test_only_uniform_refinement_leaves_all_alike():
    mesh = forget_refinement(make_structured_mesh(find_polygon("lshape"), 1 / 3))
    assert mesh.triangulation.all_alike
    assert refine_uniformly(mesh, 2).triangulation.all_alike
    assert not refine_triangles(mesh, np.array([0])).triangulation.all_alike


@pytest.mark.parametrize("name", ["square 3", "gmsh"])
@pytest.mark.parametrize("way", ["uniform", "at random"])
def test_copies_and_pickles_are_refined_in_the_same_way(name, way):
    """All arrays and steps are the same, and so are those of a mesh that is refined from them."""
    mesh = make_mesh_levels(name, way).meshes[-1]
    for again in (copy.deepcopy(mesh), pickle.loads(pickle.dumps(mesh))):
        assert len(again.steps) == len(mesh.steps) > 0
        assert (again.is_adapted, again.halvings, again.coarse.n_nodes) == (
            mesh.is_adapted,
            mesh.halvings,
            mesh.coarse.n_nodes,
        )
        for field in ("points", "triangles", "boundary", "s", "opposite_edges"):
            np.testing.assert_array_equal(getattr(again, field), getattr(mesh, field))
        for step, other_step in zip(again.steps, mesh.steps, strict=True):
            np.testing.assert_array_equal(step.nodes, other_step.nodes)
            np.testing.assert_array_equal(step.triangles, other_step.triangles)
        np.testing.assert_array_equal(again.triangulation.edge_triangles, mesh.triangulation.edge_triangles)
        finer = refine_triangles(again, np.array([0]))
        expected = refine_triangles(mesh, np.array([0]))
        np.testing.assert_array_equal(finer.triangles, expected.triangles)
        np.testing.assert_array_equal(finer.points, expected.points)
