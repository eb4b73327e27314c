"""Triangulations: what theory says of any of them, and a negative control for every check."""

import re
import sys
import threading

import gmsh
import numpy as np
import pytest
import sentences
from conftest import ROOT
from nested import SLANTED
from numpy.testing import assert_allclose, assert_array_equal

from unilateral.errors import InputError
from unilateral.geometry import partition
from unilateral.geometry.mesh import from_arrays, make_unstructured_mesh, refine_uniformly
from unilateral.geometry.outline import find_outline
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import default_mesh_kind, make_structured_cells, make_structured_mesh

WEDGE = Polygon(np.array([[0, 0], [1, 0], [np.cos(np.pi / 9), np.sin(np.pi / 9)]]), "wedge")

MAKERS = {
    "square": lambda: make_structured_mesh(square(), 1 / 8),
    "thirds": lambda: make_structured_mesh(square(), 1 / 3),
    "lshape": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 4),
    "refined": lambda: refine_uniformly(make_structured_mesh(find_polygon("lshape"), 1 / 3)),
    "gmsh square": lambda: make_unstructured_mesh(square(), 0.11),
    "gmsh lshape": lambda: make_unstructured_mesh(find_polygon("lshape"), 0.23),
    "gmsh wedge": lambda: make_unstructured_mesh(WEDGE, 0.05),
    "gmsh slanted": lambda: make_unstructured_mesh(SLANTED, 0.4),
    "gmsh refined": lambda: refine_uniformly(make_unstructured_mesh(SLANTED, 0.7)),
    "far": lambda: make_unstructured_mesh(Polygon(WEDGE.vertices + np.array([1e4, -3e3]), "far"), 0.1),
    "tiny": lambda: refine_uniformly(make_unstructured_mesh(Polygon(1e-9 * SLANTED.vertices, "tiny"), 4e-10)),
}


@pytest.fixture(params=MAKERS)
def mesh(request):
    return MAKERS[request.param]()


def round_off(polygon):
    """What a few operations on the coordinates may cost, in units of length."""
    return 20 * np.finfo(float).eps * (polygon.perimeter + np.abs(polygon.vertices).max())


def edges_of(triangles):
    return np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


def test_triangles_fill_a_disc(mesh):
    """Areas are positive and add up; n - edges + triangles = 1, and 2 edges - 3 triangles bound it."""
    assert np.all(mesh.areas > 0)
    tolerance = round_off(mesh.polygon) * mesh.polygon.perimeter
    assert_allclose(mesh.areas.sum(), mesh.polygon.area, rtol=1e-13, atol=tolerance)
    n_edges = len(edges_of(mesh.triangles))
    assert mesh.n_nodes - n_edges + len(mesh.triangles) == 1
    assert len(mesh.boundary) == 2 * n_edges - 3 * len(mesh.triangles)


def test_boundary_runs_along_the_sides(mesh):
    polygon = mesh.polygon
    assert_array_equal(mesh.s[[0, -1]], [0, polygon.perimeter])
    assert np.isin(polygon.starts, mesh.s).all()
    assert len(np.unique(mesh.boundary)) == len(mesh.boundary)
    expected = polygon.at(mesh.side, mesh.s[:-1] - polygon.starts[mesh.side])
    assert_allclose(mesh.points[mesh.boundary], expected, rtol=0, atol=round_off(polygon))
    pairs = np.sort(np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)]), axis=1)
    edges = edges_of(mesh.triangles).tolist()
    assert all(pair in edges for pair in pairs.tolist())


def test_boundary_nodes_lie_at_exactly_uniform_arc_lengths(mesh):
    counts = np.bincount(mesh.side)
    assert_array_equal(mesh.s, mesh.polygon.divided(counts))
    assert_allclose(mesh.h, (mesh.polygon.lengths / counts).max(), rtol=1e-12)


def test_checks_accept_a_mesh_and_reproduce_its_boundary(mesh):
    again = from_arrays(mesh.polygon, mesh.points, mesh.triangles)
    assert_array_equal(again.boundary, mesh.boundary)
    assert_array_equal(again.s, mesh.s)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 16])
def test_structured_meshes_have_the_counted_nodes_and_triangles(n):
    """By counting: (n + 1)^2 nodes in a square; three squares share 2 (n + 1) - 1 nodes in the L-shape."""
    for polygon, n_nodes, squares in (
        (square(), (n + 1) ** 2, 1),
        (find_polygon("lshape"), 3 * (n + 1) ** 2 - 2 * n - 2, 3),
    ):
        mesh = make_structured_mesh(polygon, 1 / n)
        assert mesh.n_nodes == n_nodes
        assert len(mesh.triangles) == 2 * squares * n**2
        assert_allclose((mesh.h, mesh.diameter), (1 / n, np.sqrt(2) / n), rtol=1e-13)
        assert_array_equal(mesh.s, partition.make_uniform_partition(polygon, 1 / n).points)
    assert make_structured_mesh(square(), 1 / (n - 0.5)).n_nodes == (n + 1) ** 2  # the number is rounded up


def test_structured_cells_are_cut_from_lower_left_to_upper_right():
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 2)
    corners = mesh.points[mesh.triangles]
    vectors = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2)
    diagonals = vectors[np.abs(vectors).min(axis=1) > 0]
    assert len(diagonals) == len(mesh.triangles)
    assert_array_equal(diagonals[:, 0], diagonals[:, 1])


@pytest.mark.parametrize("place", [1e10, 1e15, 1e16])
def test_sizes_that_rounding_takes_away_are_refused_before_gmsh(place):
    """At 1e16 nodes of different places have the same coordinates."""
    with sentences.raises(InputError):
        make_unstructured_mesh(Polygon(4 * square().vertices + place), 1)


def test_unstructured_meshes_have_the_size_asked_for_and_no_small_angle():
    """Boundary edges as asked for, triangles not much larger, no angle below the wedge's own 20 degrees."""
    for polygon, h in ((find_polygon("lshape"), 0.1), (WEDGE, 0.03)):
        mesh = make_unstructured_mesh(polygon, h)
        assert_array_equal(mesh.s, partition.make_uniform_partition(polygon, h).points)
        assert mesh.h <= h * (1 + 1e-12)
        assert mesh.diameter < 2 * h
        a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
        squares = np.stack([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))])
        smallest_angle = np.arcsin(
            2 * mesh.areas * np.sqrt(squares.min(axis=0)) / np.sqrt(squares.prod(axis=0))
        )
        assert np.rad2deg(smallest_angle.min()) >= 20 - 1e-9


def test_unstructured_is_deterministic_also_in_a_thread(capfd):
    results = [make_unstructured_mesh(find_polygon("lshape"), 0.2)]
    thread = threading.Thread(
        target=lambda: results.append(make_unstructured_mesh(find_polygon("lshape"), 0.2))
    )
    thread.start()
    thread.join()
    assert_array_equal(results[0].points, results[1].points)
    assert_array_equal(results[0].triangles, results[1].triangles)
    assert capfd.readouterr() == ("", "")
    assert not gmsh.isInitialized()


def test_what_was_checked_cannot_be_changed():
    """Nor can polygons and partitions."""
    mesh = make_structured_mesh(square(), 1 / 2)
    cells = partition.make_uniform_partition(square(), 1 / 2)
    for array in (mesh.points, mesh.triangles, mesh.boundary, mesh.s, square().vertices, cells.points):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def square_with(points=(), triangles=None, **options):
    """The square cut into four triangles at its centre (node 4), changed: arguments for `from_arrays`."""
    nodes = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], *points]
    for name, place in options.items():
        nodes[int(name[1:])] = place
    return nodes, triangles if triangles is not None else FAN


FAN = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


@pytest.mark.parametrize(
    "arrays",
    [
        ([0, 1, 2], FAN),
        ([[0, 0, 0]] * 5, FAN),
        square_with(triangles=[[0, 1, 2, 3]]),
        square_with(triangles=np.empty((0, 3))),
        square_with(p4=[np.nan, 0.5]),
        square_with(triangles=[*FAN[:3], [3, 0, 5]]),
        square_with(triangles=[*FAN[:3], [3, 0, -1]]),
        square_with(p4=[0.5, 1e-13]),
        square_with(p4=[0.5, 0]),
        square_with(triangles=[*FAN, [0, 0, 1]]),
        square_with([[0.3, 0.3]]),
        square_with([[0.5, 0.5]], [*FAN[:3], [3, 0, 5]]),
        square_with([[0.5, 0.5 + 1e-13]], [*FAN[:3], [3, 0, 5]]),
        square_with(triangles=[*FAN, [0, 1, 2]]),
        square_with([[0.2, 0.7]], [*FAN, [0, 4, 5]]),
        square_with([[0.25, 0.25]], [[0, 1, 5], [1, 4, 5], *FAN[1:]]),
        square_with(triangles=FAN[:3]),
        square_with([[0.5, -1e-6]], [[0, 5, 4], [5, 1, 4], *FAN[1:]]),
        square_with([[0.5, -0.6]], [[0, 5, 4], [5, 1, 4], *FAN[1:]]),
        ([[0, 0], [1, 0], [1, 1]], [[0, 1, 2]]),
        square_with(p2=[1, 1 + 1e-6]),
        # a fold: the triangle that lies on its neighbour, turned, is on the same side of their edge
        square_with(p4=[0.5, -0.2]),
        # a second triangle over the first, with nodes of its own
        square_with([[0.4, 0.1], [0.6, 0.1], [0.5, 0.2]], [*FAN, [5, 6, 7]]),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(arrays):
    """Control: the fan itself is accepted."""
    assert from_arrays(square(), *square_with()).n_nodes == 5
    with sentences.raises(InputError):
        from_arrays(square(), *arrays, where="here")


def test_boundary_edges_inside_are_refused():
    """All nodes lie on the sides; a strip across the corner at (1, 0) is left out."""
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0], [1, 0.5]]
    triangles = [[0, 4, 3], [4, 5, 3], [5, 2, 3]]
    with_corner = from_arrays(square(), points, [*triangles, [4, 1, 5]])
    assert len(with_corner.boundary) == 6
    points = [*points, [0.75, 0], [1, 0.25]]
    with sentences.raises(InputError):
        from_arrays(square(), points, [*triangles, [6, 1, 7]])


def test_a_boundary_covered_twice_is_refused():
    """A second fan on the first: too far away to repeat its nodes, not far enough to lie off the sides."""
    points = np.array(square_with()[0])
    triangles = np.array(FAN)
    above = points + 1e-11
    above[4, 0] = 0.6
    with sentences.raises(InputError):
        from_arrays(square(), np.concatenate([points, above]), np.concatenate([triangles, triangles + 5]))


@pytest.mark.parametrize(
    ("vertices", "size", "place"),
    [(SLANTED.vertices, 1, 0), (SLANTED.vertices, 1, 1e6)]
    + [(square().vertices, *where) for where in ((1, 0), (1e-8, 0), (1e8, 0), (1, 1e6))],
)
def test_nodes_near_their_sides_are_moved_onto_them(vertices, size, place):
    """By up to a millionth of the least height there, vertices too, at any size and place; not by twice."""
    polygon = Polygon(size * vertices + place, "moved")
    mesh = make_unstructured_mesh(polygon, polygon.lengths.max() / 5)
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    heights = 2 * mesh.areas / np.max([np.hypot(*(p - q).T) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    min_heights = np.array([heights[(mesh.triangles == node).any(axis=1)].min() for node in mesh.boundary])
    displaced = np.random.default_rng(1).choice([-1, 1], len(min_heights)) * min_heights * 1e-6
    points = mesh.points.copy()
    points[mesh.boundary] += 0.9 * displaced[:, None] * polygon.normals[mesh.side]
    original = from_arrays(polygon, points, mesh.triangles)
    assert_allclose(original.points, mesh.points, rtol=0, atol=round_off(polygon))
    assert_array_equal(from_arrays(polygon, original.points, original.triangles).points, original.points)
    k = int(np.flatnonzero(~np.isin(mesh.s[:-1], polygon.starts))[0])
    points[mesh.boundary[k]] += 1.1 * displaced[k] * polygon.normals[mesh.side[k]]
    with sentences.raises(InputError, f"boundary node {mesh.boundary[k]} ", f" off side {mesh.side[k]} of"):
        from_arrays(polygon, points, mesh.triangles)


def test_sides_parallel_to_the_axes_are_met_exactly():
    points = np.array(square_with([[0.5, 3e-8], [1 - 2e-8, 0.5]])[0])
    mesh = from_arrays(square(), points, [[0, 5, 4], [5, 1, 4], [1, 6, 4], [6, 2, 4], *FAN[2:]])
    assert_array_equal(mesh.points[5:], [[0.5, 0], [1, 0.5]])


def test_what_a_node_may_lie_beside_its_side_is_of_the_local_width():
    """On a polygon 1e7 long and 1e-3 high no node may be off by a part of its height, nor of its length."""
    x = np.concatenate([np.arange(5.0), np.geomspace(5, 1e7, 30)])
    polygon = Polygon(np.array([[0, 0], [1e7, 0], [1e7, 1e-3], [0, 1e-3]]), "strip")
    n = len(x)
    k = np.arange(len(x) - 1)
    triangles = np.stack([k, k + 1, k + n + 1, k, k + n + 1, k + n], axis=1).reshape(-1, 3)
    for wave, refused in ((0.5, True), (1e-3, True), (1e-5, False)):
        top = 1e-3 * (1 + wave * np.sin(0.4 * np.pi * x) * (x > 0) * (x < 1e7))
        points = np.concatenate([np.stack([x, 0 * x], axis=1), np.stack([x, top], axis=1)])
        if refused:
            with sentences.raises(InputError):
                from_arrays(polygon, points, triangles)
        else:  # by round-off at 1e7
            assert from_arrays(polygon, points, triangles).n_nodes == 2 * n


@pytest.mark.parametrize("every", [1, 3])
def test_clockwise_triangles_are_turned(every):
    """All, or every third one; the outline is the same, too."""
    mesh = make_unstructured_mesh(SLANTED, 0.7)
    turned = mesh.triangles.copy()
    turned[::every] = turned[::every, ::-1]
    original = from_arrays(SLANTED, mesh.points, turned)
    assert_array_equal(original.boundary, mesh.boundary)
    assert_array_equal(original.s, mesh.s)
    assert np.all(original.areas > 0)
    assert_array_equal(np.sort(original.triangles, axis=1), np.sort(mesh.triangles, axis=1))
    assert_allclose(find_outline(mesh.points, turned, "turned").polygon.area, SLANTED.area, rtol=1e-13)


U = np.array([[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]])
"""Five unit squares."""


@pytest.mark.parametrize("scale", [1, 0.5, 1e-3, 0.3, 7])
def test_any_polygon_along_the_axes_has_structured_meshes(scale):
    """A U of five squares, larger or smaller: four small squares in each, 40 triangles.

    24 nodes lie on the boundary and so, by Euler's formula, 9 inside. Unit squares would be many in a U that
    is 21 wide; the gaps between its vertices are cut.
    """
    mesh = make_structured_mesh(Polygon(scale * U, "U"), scale / 2)
    assert (len(mesh.triangles), mesh.n_nodes) == (40, 24 + 9)
    assert mesh.h == pytest.approx(scale / 2)
    assert mesh.areas.sum() == pytest.approx(5 * scale**2)


def test_gaps_between_vertices_are_cut_into_parts_of_their_own():
    """By hand, in parts of 1/3 at most: 2 from 0 to 1/2 and 1 to 3/4 along x, 1 to 0.2 and 3 to 1 along y."""
    step = Polygon(np.array([[0, 0], [0.75, 0], [0.75, 0.2], [0.5, 0.2], [0.5, 1], [0, 1]]), "step")
    mesh = make_structured_mesh(step, 1 / 3)
    assert len(mesh.triangles) == 2 * (3 * 1 + 2 * 3)
    assert set(mesh.points[:, 0]) == {0, 0.25, 0.5, 0.75}
    halved, cells = make_structured_cells(step, 1 / 3, 2, 1)
    # each edge of the mesh is two cells of two edges
    edges = np.diff(halved.s)
    assert_allclose(edges[0::2], edges[1::2])
    assert_allclose(cells.points, halved.s[::2])
    assert_allclose(cells.points[::2], mesh.s)
    assert len(edges) == 4 * len(mesh.boundary)


def test_a_gmsh_that_does_not_load_is_told_with_the_line_to_type(tmp_path, monkeypatch):
    """As in a container without its system libraries, which set-up names, too."""
    (tmp_path / "gmsh.py").write_text("raise OSError('libGLU.so.1: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    for module in ("gmsh", "unilateral.geometry.triangulate"):
        monkeypatch.delitem(sys.modules, module)
    with sentences.raises(InputError) as error:
        make_unstructured_mesh(SLANTED, 1 / 2)
    (libraries,) = re.findall(r'^libraries="(.*)"$', (ROOT / "setup.sh").read_text(), re.MULTILINE)
    assert str(error.value).endswith(f"apt-get install {libraries}")


def test_without_gmsh_what_has_a_structured_mesh_gets_it(monkeypatch):
    """Unit squares get it anyway; slanted sides, and lines as near as rounding, do not."""
    u = Polygon(U, "U")
    half = Polygon(0.5 * U, "half")
    narrow = Polygon(np.array([[0, 0], [1, 0], [1, 1], [0.5, 1], [0.5, 1 + 1e-12], [0, 1 + 1e-12]]), "narrow")
    polygons = u, half, SLANTED, narrow
    assert [default_mesh_kind(polygon) for polygon in polygons] == ["structured", *3 * ["unstructured"]]
    monkeypatch.setitem(sys.modules, "gmsh", None)
    assert [default_mesh_kind(polygon) for polygon in polygons] == 2 * ["structured"] + 2 * ["unstructured"]
    for polygon_without_mesh in (SLANTED, narrow):
        with sentences.raises(InputError):
            make_structured_mesh(polygon_without_mesh, 1 / 2)
        with sentences.raises(InputError):
            make_unstructured_mesh(polygon_without_mesh, 1 / 2)
