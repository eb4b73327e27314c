"""Triangulations: what theory says of any of them, files, and a negative control for every check."""

import re
import threading

import gmsh
import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from unilateral.errors import InputError
from unilateral.geometry import partition
from unilateral.geometry.files import outline, read_mesh, write_mesh
from unilateral.geometry.mesh import from_arrays, refine, unstructured
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import natural_kind, structured

WEDGE = Polygon(np.array([[0, 0], [1, 0], [np.cos(np.pi / 9), np.sin(np.pi / 9)]]), "wedge")
SLANTED = Polygon(np.array([[0, 0], [3, 1], [2.5, 2], [4, 4], [0.5, 3]]), "slanted")

MAKERS = {
    "square": lambda: structured(square(), 1 / 8),
    "thirds": lambda: structured(square(), 1 / 3),
    "lshape": lambda: structured(named("lshape"), 1 / 4),
    "refined": lambda: refine(structured(named("lshape"), 1 / 3)),
    "gmsh square": lambda: unstructured(square(), 0.11),
    "gmsh lshape": lambda: unstructured(named("lshape"), 0.23),
    "gmsh wedge": lambda: unstructured(WEDGE, 0.05),
    "gmsh slanted": lambda: unstructured(SLANTED, 0.4),
    "gmsh refined": lambda: refine(unstructured(SLANTED, 0.7)),
    "far": lambda: unstructured(Polygon(WEDGE.vertices + np.array([1e4, -3e3]), "far"), 0.1),
    "tiny": lambda: refine(unstructured(Polygon(1e-9 * SLANTED.vertices, "tiny"), 4e-10)),
}


@pytest.fixture(params=MAKERS)
def mesh(request):
    return MAKERS[request.param]()


def round_off(polygon):
    """What a few operations on the coordinates may cost, in units of length."""
    return 20 * np.finfo(float).eps * (polygon.perimeter + np.abs(polygon.vertices).max())


def edges_of(triangles):
    return np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


def canonical(mesh):
    """The triangles as sorted rows of coordinates: equal for equal meshes, whatever their numbering."""
    nodes = np.lexsort(mesh.points.T)
    number = np.argsort(nodes)
    rows = np.sort(number[mesh.triangles], axis=1)
    return mesh.points[nodes], rows[np.lexsort(rows.T)]


def test_areas_are_positive_and_add_up(mesh):
    assert np.all(mesh.areas > 0)
    tolerance = round_off(mesh.polygon) * mesh.polygon.perimeter
    assert_allclose(mesh.areas.sum(), mesh.polygon.area, rtol=1e-13, atol=tolerance)


def test_euler_characteristic(mesh):
    """n - edges + triangles = 1 for a triangulated disc, whose boundary has 2 edges - 3 triangles edges."""
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


def test_checks_accept_and_reproduce(mesh):
    again = from_arrays(mesh.polygon, mesh.points, mesh.triangles)
    assert_array_equal(again.boundary, mesh.boundary)
    assert_array_equal(again.s, mesh.s)


@pytest.mark.parametrize("n", [1, 2, 3, 7, 16])
def test_structured_sizes(n):
    """By counting: (n + 1)^2 nodes in a square; three squares share 2 (n + 1) - 1 nodes in the L-shape."""
    for polygon, n_nodes, squares in (
        (square(), (n + 1) ** 2, 1),
        (named("lshape"), 3 * (n + 1) ** 2 - 2 * n - 2, 3),
    ):
        mesh = structured(polygon, 1 / n)
        assert mesh.n_nodes == n_nodes
        assert len(mesh.triangles) == 2 * squares * n**2
        assert_allclose((mesh.h, mesh.diameter), (1 / n, np.sqrt(2) / n), rtol=1e-13)
        assert_array_equal(mesh.s, partition.uniform(polygon, 1 / n).points)


def test_structured_cells_are_cut_from_lower_left_to_upper_right():
    mesh = structured(named("lshape"), 1 / 2)
    corners = mesh.points[mesh.triangles]
    vectors = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2)
    diagonals = vectors[np.abs(vectors).min(axis=1) > 0]
    assert len(diagonals) == len(mesh.triangles)
    assert_array_equal(diagonals[:, 0], diagonals[:, 1])


def test_structured_rounds_the_number_of_squares_up():
    assert structured(square(), 0.3).h == 0.25


@pytest.mark.parametrize("polygon", [square(), named("lshape")], ids=["square", "lshape"])
def test_refined_structured_is_structured(polygon):
    """Dyadic coordinates: equality is exact."""
    for ours, expected in zip(
        canonical(refine(structured(polygon, 1 / 4))), canonical(structured(polygon, 1 / 8)), strict=True
    ):
        assert_array_equal(ours, expected)


def test_children_are_their_parent_halved():
    """Edge vectors of the corner children are half the parent's, of the middle one minus half, in order."""
    coarse = unstructured(SLANTED, 1.0)
    fine = refine(coarse)
    edges = [np.roll(m.points[m.triangles], -1, axis=1) - m.points[m.triangles] for m in (coarse, fine)]
    T = len(coarse.triangles)
    children = np.arange(T)[:, None] + T * np.arange(4)
    expected = np.stack([edges[0] / 2] * 3 + [-edges[0] / 2], axis=1)
    assert_allclose(edges[1][children], expected, rtol=0, atol=1e-14)
    assert_array_equal(fine.points[: coarse.n_nodes], coarse.points)


@pytest.mark.parametrize("place", [1e10, 1e15, 1e16])
def test_sizes_that_rounding_takes_away_are_refused_before_gmsh(place):
    """At 1e16 nodes of different places have the same coordinates."""
    with pytest.raises(InputError, match=r"coordinates as large as 1e\+1\d are rounded by .*; move polygon"):
        unstructured(Polygon(4 * square().vertices + place), 1)


def test_unstructured_size_and_shape():
    """Boundary edges as asked for, triangles not much larger, no angle below the wedge's own 20 degrees."""
    for polygon, h in ((named("lshape"), 0.1), (WEDGE, 0.03)):
        mesh = unstructured(polygon, h)
        assert_array_equal(mesh.s, partition.uniform(polygon, h).points)
        assert mesh.h <= h * (1 + 1e-12)
        assert mesh.diameter < 2 * h
        a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
        squares = np.stack([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))])
        smallest_angle = np.arcsin(
            2 * mesh.areas * np.sqrt(squares.min(axis=0)) / np.sqrt(squares.prod(axis=0))
        )
        assert np.rad2deg(smallest_angle.min()) >= 20 - 1e-9


def test_unstructured_is_deterministic_also_in_a_thread(capfd):
    results = [unstructured(named("lshape"), 0.2)]
    thread = threading.Thread(target=lambda: results.append(unstructured(named("lshape"), 0.2)))
    thread.start()
    thread.join()
    assert_array_equal(results[0].points, results[1].points)
    assert_array_equal(results[0].triangles, results[1].triangles)
    assert capfd.readouterr() == ("", "")
    assert not gmsh.isInitialized()


def test_meshes_cannot_be_changed(mesh):
    for array in (mesh.points, mesh.triangles, mesh.boundary, mesh.s):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_files_keep_every_bit(mesh, tmp_path):
    write_mesh(mesh, tmp_path / "mesh.vtu")
    again = read_mesh(tmp_path / "mesh.vtu", mesh.polygon)
    for name in ("points", "triangles", "boundary", "s", "side"):
        assert_array_equal(getattr(again, name), getattr(mesh, name))


@pytest.mark.parametrize("ending", ["vtu", "vtk", "mesh", "inp"])
def test_formats(ending, tmp_path):
    mesh = structured(named("lshape"), 1 / 4)
    write_mesh(mesh, tmp_path / f"mesh.{ending}")
    assert_array_equal(read_mesh(tmp_path / f"mesh.{ending}", named("lshape")).points, mesh.points)


def test_writing_twice_gives_the_same_bytes_and_nothing_else(tmp_path):
    mesh = unstructured(named("lshape"), 0.3)
    (tmp_path / "b.vtu").write_text("an older file")
    write_mesh(mesh, tmp_path / "a.vtu")
    write_mesh(mesh, tmp_path / "b.vtu")
    assert (tmp_path / "a.vtu").read_bytes() == (tmp_path / "b.vtu").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.vtu", "b.vtu"]


def test_files_carry_the_sides(tmp_path):
    """The square with two triangles: its boundary edges are its sides, in order; triangles carry -1."""
    write_mesh(structured(square(), 1), tmp_path / "mesh.vtu")
    stored = meshio.read(tmp_path / "mesh.vtu")
    assert [block.type for block in stored.cells] == ["triangle", "line"]
    assert [sides.tolist() for sides in stored.cell_data["side"]] == [[-1, -1], [0, 1, 2, 3]]


def test_a_file_of_gmsh_is_read(tmp_path):
    """Written by gmsh itself, with its points and curves as cells and without sides."""
    path = str(tmp_path / "gmsh.msh")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.25)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.25)
        gmsh.model.mesh.generate(2)
        gmsh.write(path)
    finally:
        gmsh.finalize()
    mesh = read_mesh(path, square())
    assert_array_equal(np.bincount(mesh.side), [4, 4, 4, 4])


def square_with(points=(), triangles=None, **moved):
    """The square cut into four triangles at its centre (node 4), changed: arguments for `from_arrays`."""
    nodes = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0.5], *points]
    for name, place in moved.items():
        nodes[int(name[1:])] = place
    return nodes, triangles if triangles is not None else FAN


FAN = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]


def test_the_fan_itself_is_accepted():
    assert from_arrays(square(), *square_with()).n_nodes == 5


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (([0, 1, 2], FAN), r"points have the shape \(3,\)"),
        (([[0, 0, 0]] * 5, FAN), r"points have the shape \(5, 3\)"),
        (square_with(triangles=[[0, 1, 2, 3]]), r"triangles have the shape \(1, 4\)"),
        (square_with(triangles=np.empty((0, 3))), r"triangles have the shape \(0, 3\)"),
        (square_with(p4=[np.nan, 0.5]), "node 4 has a coordinate that is not a finite"),
        (square_with(triangles=[*FAN[:3], [3, 0, 5]]), r"triangle 3 has the nodes \[3, 0, 5\].* 0 to 4"),
        (square_with(triangles=[*FAN[:3], [3, 0, -1]]), r"triangle 3 has the nodes \[3, 0, -1\]"),
        (square_with(p4=[0.5, 1e-13]), "triangle 0 .* is degenerate"),
        (square_with(p4=[0.5, 0]), "triangle 0 .* is degenerate"),
        (square_with(triangles=[*FAN, [0, 0, 1]]), "triangle 4 .* is degenerate"),
        (square_with([[0.3, 0.3]]), r"node 5 \(0.3, 0.3\) belongs to no triangle"),
        (square_with([[0.5, 0.5]], [*FAN[:3], [3, 0, 5]]), r"node 5 repeats node 4 \(0.5, 0.5\)"),
        (square_with([[0.5, 0.5 + 1e-13]], [*FAN[:3], [3, 0, 5]]), "node 5 repeats node 4"),
        (square_with(triangles=[*FAN, [0, 1, 2]]), r"edge from node 0 \(0, 0\) to node 1 .* belongs to 2"),
        (square_with([[0.2, 0.7]], [*FAN, [0, 4, 5]]), r"edge from node 0 .* to node 4 .* belongs to 3"),
        (square_with([[0.25, 0.25]], [[0, 1, 5], [1, 4, 5], *FAN[1:]]), "edge from node 0 .* to node 4"),
        (square_with(triangles=FAN[:3]), r"edge from node 4 \(0.5, 0.5\) to .* does not run anti"),
        (
            square_with([[0.5, -1e-6]], [[0, 5, 4], [5, 1, 4], *FAN[1:]]),
            r"node 5 \(0.5, -1e-06\) lies 1e-06 beside side 0",
        ),
        (square_with([[0.5, -0.6]], [[0, 5, 4], [5, 1, 4], *FAN[1:]]), "edge from node . .* does not run"),
        (([[0, 0], [1, 0], [1, 1]], [[0, 1, 2]]), r"no node lies at vertex 3 of .*'square', \(0.0, 1.0\)"),
        (square_with(p2=[1, 1 + 1e-6]), "no node lies at vertex 2"),
    ],
)
def test_refusals(arrays, message):
    with pytest.raises(InputError, match=f"^here: .*({message})"):
        from_arrays(square(), *arrays, where="here")


def test_boundary_edges_inside_are_refused():
    """All nodes lie on the sides; a strip across the corner at (1, 0) is left out."""
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 0], [1, 0.5]]
    triangles = [[0, 4, 3], [4, 5, 3], [5, 2, 3]]
    with_corner = from_arrays(square(), points, [*triangles, [4, 1, 5]])
    assert len(with_corner.boundary) == 6
    points = [*points, [0.75, 0], [1, 0.25]]
    with pytest.raises(InputError, match=r"edge from node 4 .* does not run anticlockwise along one side"):
        from_arrays(square(), points, [*triangles, [6, 1, 7]])


def test_a_boundary_covered_twice_is_refused():
    """A second fan on the first: too far away to repeat its nodes, not far enough to lie off the sides."""
    points, triangles = np.array(square_with()[0]), np.array(FAN)
    above = points + 1e-11
    above[4, 0] = 0.6
    with pytest.raises(InputError, match="do not cover polygon 'square' once"):
        from_arrays(square(), np.concatenate([points, above]), np.concatenate([triangles, triangles + 5]))


@pytest.mark.parametrize("polygon", [square(), SLANTED, Polygon(SLANTED.vertices + 1e6, "far")])
def test_nodes_near_their_sides_are_moved_onto_them(polygon):
    """Up to a millionth of the least height at a node, vertices too; twice that is refused."""
    mesh = unstructured(polygon, polygon.lengths.max() / 5)
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    heights = 2 * mesh.areas / np.max([np.hypot(*(p - q).T) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    least = np.array([heights[(mesh.triangles == node).any(axis=1)].min() for node in mesh.boundary])
    off = np.random.default_rng(1).choice([-1, 1], len(least)) * least * 1e-6
    points = mesh.points.copy()
    points[mesh.boundary] += 0.9 * off[:, None] * polygon.normals[mesh.side]
    own = from_arrays(polygon, points, mesh.triangles)
    assert_allclose(own.points, mesh.points, rtol=0, atol=round_off(polygon))
    assert_array_equal(from_arrays(polygon, own.points, own.triangles).points, own.points)
    k = int(np.flatnonzero(~np.isin(mesh.s[:-1], polygon.starts))[0])
    points[mesh.boundary[k]] += 1.1 * off[k] * polygon.normals[mesh.side[k]]
    with pytest.raises(
        InputError, match=f"boundary node {mesh.boundary[k]} .* beside side {mesh.side[k]} of"
    ):
        from_arrays(polygon, points, mesh.triangles)


def test_sides_parallel_to_the_axes_are_met_exactly():
    points = np.array(square_with([[0.5, 3e-8], [1 - 2e-8, 0.5]])[0])
    mesh = from_arrays(square(), points, [[0, 5, 4], [5, 1, 4], [1, 6, 4], [6, 2, 4], *FAN[2:]])
    assert_array_equal(mesh.points[5:], [[0.5, 0], [1, 0.5]])


def test_what_a_node_may_lie_beside_its_side_is_of_the_local_width():
    """On a polygon 1e7 long and 1e-3 high no node may be off by a part of its height, nor of its length."""
    x = np.concatenate([np.arange(5.0), np.geomspace(5, 1e7, 30)])
    polygon = Polygon(np.array([[0, 0], [1e7, 0], [1e7, 1e-3], [0, 1e-3]]), "strip")
    bottom, last = np.arange(len(x) - 1), len(x)
    triangles = np.concatenate(
        [
            np.stack([bottom, bottom + 1, bottom + last + 1], axis=1),
            np.stack([bottom, bottom + last + 1, bottom + last], axis=1),
        ]
    )
    for wave, refused in ((0.5, True), (1e-3, True), (1e-5, False)):
        top = 1e-3 * (1 + wave * np.sin(0.4 * np.pi * x) * (x > 0) * (x < 1e7))
        points = np.concatenate([np.stack([x, 0 * x], axis=1), np.stack([x, top], axis=1)])
        if refused:
            with pytest.raises(
                InputError, match=r"the boundary node \d+ .* beside side 2 of polygon 'strip'"
            ):
                from_arrays(polygon, points, triangles)
        else:  # by round-off at 1e7
            assert from_arrays(polygon, points, triangles).n_nodes == 2 * len(x)


def turn_all(triangles):
    return triangles[:, ::-1]


def turn_some(triangles):
    return np.where(np.arange(len(triangles))[:, None] % 3 == 0, triangles[:, [1, 0, 2]], triangles)


@pytest.mark.parametrize("turn", [turn_all, turn_some])
def test_clockwise_triangles_are_turned(turn, tmp_path):
    mesh = unstructured(SLANTED, 0.7)
    own = from_arrays(SLANTED, mesh.points, turn(mesh.triangles))
    assert_array_equal(own.boundary, mesh.boundary)
    assert_array_equal(own.s, mesh.s)
    assert np.all(own.areas > 0)
    assert_array_equal(np.sort(own.triangles, axis=1), np.sort(mesh.triangles, axis=1))
    cells = [("triangle", turn(mesh.triangles))]
    meshio.Mesh(np.column_stack([mesh.points, 0 * mesh.s[:1].repeat(mesh.n_nodes)]), cells).write(
        tmp_path / "turned.vtu"
    )
    assert_allclose(read_mesh(tmp_path / "turned.vtu").polygon.area, SLANTED.area)


def test_a_fold_is_refused():
    """A triangle that lies on its neighbour, turned, is on the same side of their edge as that."""
    with pytest.raises(InputError, match="belongs to 2 triangles, two of them on the same side"):
        from_arrays(square(), *square_with(p4=[0.5, -0.2]))


def test_overlapping_triangles_are_refused():
    """A second triangle over the first, with nodes of its own."""
    points, triangles = square_with([[0.4, 0.1], [0.6, 0.1], [0.5, 0.2]], [*FAN, [5, 6, 7]])
    with pytest.raises(InputError, match="does not run anticlockwise"):
        from_arrays(square(), points, triangles)


def test_tolerances_follow_the_polygon():
    """What is refused at size 1 is refused at any size, and round-off far away is not."""
    for size, place in ((1.0, 0.0), (1e-8, 0.0), (1e8, 0.0), (1.0, 1e6)):
        polygon = Polygon(size * square().vertices + place)
        mesh = unstructured(polygon, 0.3 * size)
        from_arrays(polygon, mesh.points, mesh.triangles)
        points = mesh.points.copy()
        points[mesh.boundary[1], 1] -= 1e-6 * size
        with pytest.raises(InputError, match=f"node {mesh.boundary[1]} .* beside side 0"):
            from_arrays(polygon, points, mesh.triangles)


def stored(tmp_path, change):
    """A VTU file of the square with two triangles, its meshio mesh changed before it is written."""
    write_mesh(structured(square(), 1), tmp_path / "mesh.vtu")
    content = meshio.read(tmp_path / "mesh.vtu")
    change(content)
    content.write(tmp_path / "mesh.vtu")
    return tmp_path / "mesh.vtu"


def lift(content):
    content.points[0, 2] = 0.1


def quadrilateral(content):
    content.cells[0] = meshio.CellBlock("quad", np.array([[0, 1, 3, 2]]))
    content.cell_data["side"][0] = np.array([-1])


def only_lines(content):
    content.cells = content.cells[1:]
    content.cell_data["side"] = content.cell_data["side"][1:]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lift, r"points have the shape \(4, 3\)"),
        (quadrilateral, "cells of type quad"),
        (only_lines, "the file has no triangles"),
    ],
)
def test_changed_files_are_refused(change, message, tmp_path):
    with pytest.raises(InputError, match=f"mesh.vtu: .*{message}"):
        read_mesh(stored(tmp_path, change), square())


@pytest.mark.parametrize("name", ["missing.vtu", "garbled.vtu", "garbled.msh", "mesh.nothing"])
def test_unreadable_files_are_named(name, tmp_path, capfd):
    if name != "missing.vtu":
        (tmp_path / name).write_text("this is no mesh")
    with pytest.raises(InputError, match=f"{name}: no mesh can be read"):
        read_mesh(tmp_path / name, square())
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("header.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "the file has no nodes"),
        ("empty.inp", "", "the file has no nodes"),
        ("title.inp", "*HEADING\nsquare\n*NODE\n", "the file has no nodes"),
        ("nodes.inp", "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n", "the file has no triangles"),
        ("cut.inp", "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n*ELEMENT, TYPE=S3\n", "the file has no triangles"),
    ],
)
def test_files_without_nodes_or_triangles_are_refused(name, content, message, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=f"{name}: {message}"):
        read_mesh(tmp_path / name, square())


NONE_2_2 = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n0\n$EndNodes\n"


@pytest.mark.parametrize(
    ("name", "content"), [("none.msh", NONE_2_2), ("empty.msh", ""), ("cut.vtk", "# vtk")]
)
def test_malformed_files_are_told_in_words_not_in_those_of_numpy(name, content, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=name) as refused:
        read_mesh(tmp_path / name, square())
    assert not re.search("array|shape|index|identity|expected|block", str(refused.value))


@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh", "mesh", "inp", "stl", "avs"])
def test_cut_off_files_are_refused(ending, tmp_path):
    """After any tenth of it a file is no mesh of the square, and is told so with its name."""
    write_mesh(structured(square(), 1 / 2), tmp_path / f"whole.{ending}")
    content = (tmp_path / f"whole.{ending}").read_bytes()
    for tenths in range(10):
        (tmp_path / f"cut.{ending}").write_bytes(content[: len(content) * tenths // 10])
        with pytest.raises(InputError, match=f"cut.{ending}: "):
            read_mesh(tmp_path / f"cut.{ending}", square())


def test_an_unknown_format_is_not_written(tmp_path):
    with pytest.raises(InputError, match=r"mesh\.nothing.* cannot be written"):
        write_mesh(structured(square(), 1), tmp_path / "mesh.nothing")
    assert not list(tmp_path.iterdir())


def test_any_polygon_of_unit_squares_has_structured_meshes():
    """A U of five squares: its area, its sizes, and a refusal of half squares."""
    u = Polygon(np.array([[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]]), "U")
    mesh = structured(u, 1 / 2)
    assert (len(mesh.triangles), mesh.h) == (40, 0.5)
    assert mesh.areas.sum() == pytest.approx(5)
    half = Polygon(0.5 * u.vertices, "half")
    assert (natural_kind(u), natural_kind(half)) == ("structured", "unstructured")
    with pytest.raises(InputError, match=r"'half' has no structured mesh.*unstructured"):
        structured(half, 1 / 2)


def test_a_file_s_own_outline_is_a_polygon(tmp_path):
    """Of the L-shape, by its corners only; a square with a hole is refused."""
    write_mesh(structured(named("lshape"), 1 / 3), tmp_path / "l.vtu")
    found = read_mesh(tmp_path / "l.vtu").polygon
    assert found.n_sides == 6
    assert found.area == pytest.approx(3)
    ring = structured(square(), 1 / 3)
    kept = ~np.all(np.abs(ring.points[ring.triangles].mean(axis=1) - 0.5) < 1 / 6, axis=1)
    with pytest.raises(InputError, match="must be one closed line"):
        outline(ring.points, ring.triangles[kept], "ring")
