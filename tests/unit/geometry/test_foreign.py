"""Meshes of other programs and of arrays: read alike, and refused in one sentence each."""

from types import SimpleNamespace

import gmsh
import matplotlib.tri
import meshio
import numpy as np
import pytest
import sentences
import skfem

import unilateral as ul
from unilateral.geometry import foreign, outline

MESH = skfem.MeshTri().refined(3)
POINTS = MESH.p.T
TRIANGLES = MESH.t.T
CENTRES = POINTS[TRIANGLES].mean(axis=1) - 0.5


def disc(folder, size):
    """A disc of radius 1, as gmsh writes it."""
    path = str(folder / "disc.msh")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", size)
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
        gmsh.model.mesh.generate(2)
        gmsh.write(path)
    finally:
        gmsh.finalize()
    return path


def some(retained):
    """The triangles that are kept, with the nodes they need."""
    used, triangles = np.unique(TRIANGLES[retained], return_inverse=True)
    return POINTS[used], triangles.reshape(-1, 3)


def lift_to_space():
    return np.column_stack([POINTS, np.zeros(len(POINTS))])


@pytest.mark.parametrize(
    "data",
    [
        (POINTS, TRIANGLES),
        (POINTS.tolist(), TRIANGLES.tolist()),
        (POINTS, TRIANGLES[:, ::-1]),
        (lift_to_space(), TRIANGLES.astype(float)),
        (MESH,),
        (meshio.Mesh(lift_to_space(), [("triangle", TRIANGLES)]),),
        (matplotlib.tri.Triangulation(*POINTS.T, TRIANGLES),),
    ],
    ids=["arrays", "lists", "clockwise", "in space", "scikit-fem", "meshio", "matplotlib"],
)
def test_the_same_mesh_is_read_from_each(data):
    """Nodes keep their numbers, which arrays at nodes rest on; the square has four sides."""
    mesh = ul.mesh(*data)
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert {frozenset(triangle) for triangle in mesh.triangles.tolist()} == {
        frozenset(triangle) for triangle in TRIANGLES.tolist()
    }
    assert mesh.areas.min() > 0
    assert mesh.polygon.n_sides == 4


def test_masked_triangles_are_left_out():
    mask = CENTRES[:, 0] > 0
    points, triangles = some(~mask)
    triangulation = matplotlib.tri.Triangulation(*POINTS.T, TRIANGLES, mask=mask)
    with sentences.raises(ul.InputError):
        ul.mesh(triangulation)
    assert ul.mesh(points, triangles).polygon.area == pytest.approx(0.5)


def test_masks_on_objects_of_other_programs_are_seen():
    """Their constructors drop masks; who sets the attribute afterwards keeps one. Control: without a mask."""
    masked = np.ma.masked_array(POINTS, mask=POINTS == 1)
    matplotlib_mesh = matplotlib.tri.Triangulation(*POINTS.T, TRIANGLES)
    meshio_mesh = meshio.Mesh(lift_to_space(), [("triangle", TRIANGLES)])
    assert ul.mesh(matplotlib_mesh).n_nodes == ul.mesh(meshio_mesh).n_nodes == len(POINTS)
    matplotlib_mesh.x = masked[:, 0]
    meshio_mesh.points = masked
    for foreign_mesh, field in ((matplotlib_mesh, "x"), (meshio_mesh, "points")):
        with sentences.raises(ul.InputError, field):
            ul.mesh(foreign_mesh)


@pytest.mark.parametrize(
    "data",
    [
        SimpleNamespace(p=None, t=None),
        SimpleNamespace(p=POINTS.T, t=[1, 2]),
        SimpleNamespace(points=POINTS, cells=[("triangle", TRIANGLES)]),
    ],
    ids=["nothing", "numbers", "tuples"],
)
def test_what_looks_like_a_mesh_of_another_program_is_none(data):
    """As older versions of these programs made them. Control: the arrays in a right place."""
    with sentences.raises(ul.InputError):
        ul.mesh(data)
    assert ul.mesh(SimpleNamespace(p=POINTS.T, t=TRIANGLES.T)).n_nodes == len(POINTS)


@pytest.mark.parametrize("times", [True, False, 1.0, np.True_])
def test_halvings_are_whole_numbers(times):
    with sentences.raises(ul.InputError):
        ul.mesh(MESH, halvings=times)


def test_halving_keeps_the_polygon_and_the_numbers_of_nodes():
    mesh = ul.mesh(MESH)
    finer = ul.mesh(mesh, halvings=2)
    assert finer.polygon is mesh.polygon
    np.testing.assert_array_equal(finer.points[: mesh.n_nodes], mesh.points)
    assert len(finer.triangles) == 16 * len(mesh.triangles)
    assert ul.mesh(mesh) is mesh


BOTH = np.r_[TRIANGLES, TRIANGLES + len(POINTS)]
REFUSED = {
    "unused": (np.r_[POINTS, [[2, 2]]], TRIANGLES),
    "quads": (POINTS, [[0, 1, 2, 3]]),
    "quads of scikit-fem": (skfem.MeshQuad(),),
    "from 1": (POINTS, TRIANGLES + 1),
    "fractions": (POINTS, TRIANGLES / 2),
    "words": (POINTS, "triangles"),
    "in space": (np.c_[POINTS, POINTS[:, 0]], TRIANGLES),
    "flat": (POINTS[:, :1], TRIANGLES),
    "ragged": ([(0, 0), (1,), (1, 1)], [[0, 1, 2]]),
    "NaN": (np.where(POINTS == 0.5, np.nan, POINTS), TRIANGLES),
    "twice": (np.r_[POINTS, POINTS], BOTH),
    "a hole": some(np.hypot(*CENTRES.T) > 0.2),
    "two parts": (np.r_[POINTS, POINTS + 2], BOTH),
    "a chain": some(CENTRES[:, 0] * CENTRES[:, 1] > 0),
    "no triangles": (POINTS, TRIANGLES[:0]),
    "points alone": (POINTS,),
    "a number": (3,),
}


@pytest.mark.parametrize("mesh", REFUSED.values(), ids=REFUSED)
def test_what_is_no_mesh_is_refused_in_one_sentence(mesh):
    with sentences.raises(ul.InputError) as refused:
        ul.mesh(*mesh)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("halvings", [-1, 1.5, "1", 99])
def test_halvings_that_are_no_number_of_times_are_refused(halvings):
    with sentences.raises(ul.InputError):
        ul.mesh(MESH, halvings=halvings)


def test_a_mesh_that_gets_too_large_is_refused(monkeypatch):
    monkeypatch.setattr(foreign, "available_mb", lambda: 1.0)
    with sentences.raises(ul.InputError):
        ul.mesh(MESH, halvings=3)
    assert ul.mesh(MESH, halvings=1).n_nodes == 289


def test_a_boundary_with_too_many_corners_is_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(outline, "MAX_VERTICES", 10)
    with sentences.raises(ul.InputError):
        ul.mesh(disc(tmp_path, 0.5))


def test_a_disc_is_certified_on_a_mesh_that_was_halved(tmp_path):
    """Control: not halved, each boundary edge is a side, and lambda_H may not be unique."""
    path = disc(tmp_path, 0.15)
    coarse = ul.mesh(path)
    assert coarse.polygon.n_sides == len(coarse.boundary) > 40
    with pytest.warns(ul.SolutionWarning, match=r"take ul\.mesh\(mesh, halvings=1\)"):
        assert not ul.solve(ul.Problem(coarse, f="3*x - 1", g=0), H=0.2).unique
    solver = ul.Solver(ul.Problem(ul.mesh(path, halvings=2), f="3*x - 1", g=0), H=0.2)
    s = solver()
    assert s.unique
    assert s.bounds.u < 0.05 * np.sqrt(s.u @ solver.matrices().A @ s.u)
    force = s.forces().whole
    assert force.lower < force.value < force.upper


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
FROM_1 = [(1, 0), (1, 1), (0, 1), (0, 0)]
POLYGONS = {
    "vertices": SQUARE,
    "an array": np.array(SQUARE),
    "a polygon": ul.Polygon(SQUARE, "square"),
    "a problem": ul.Problem(SQUARE, f=-1, g=0),
    "functions": ul.Problem(SQUARE, f=lambda x, y: x + y, g=0),
    "a case": ul.case("natural"),
    "a mesh": ul.mesh(MESH),
    "a name": "square",
}


@pytest.mark.parametrize("data", POLYGONS.values(), ids=POLYGONS)
def test_a_polygon_is_given_in_any_form(data):
    """Vertex 0 is that of the polygon. Control: without one it is that of the node with the least number."""
    mesh = ul.mesh(POINTS, TRIANGLES, polygon=data)
    np.testing.assert_array_equal(mesh.polygon.vertices, SQUARE)
    other_mesh = ul.mesh(POINTS, TRIANGLES, polygon=FROM_1)
    np.testing.assert_array_equal(other_mesh.points[other_mesh.boundary[0]], FROM_1[0])


def test_a_polygon_is_that_of_a_yaml_file(tmp_path):
    (tmp_path / "own.yaml").write_text("{polygon: [[1, 0], [1, 1], [0, 1], [0, 0]], f: -1, g: 0}")
    for file in (tmp_path / "own.yaml", str(tmp_path / "own.yaml")):
        np.testing.assert_array_equal(ul.mesh(MESH, polygon=file).polygon.vertices, FROM_1)


@pytest.mark.parametrize(
    "data",
    [
        3,
        "sqare",
        [(0, 0), (1, 0)],
        [(0, 0), (1, 0), ("a", 1)],
        SQUARE[::-1],
        [(0, 0), (2, 0), (2, 1), (0, 1)],
        {"polygon": 3},
    ],
)
def test_what_is_no_polygon_is_refused(data):
    with sentences.raises(ul.InputError):
        ul.mesh(POINTS, TRIANGLES, polygon=data)


def test_a_polygon_of_no_numbers_is_refused():
    with sentences.raises(ul.InputError):
        ul.Polygon("square")


@pytest.mark.parametrize(
    "data", [skfem.MeshTri2().refined(1), meshio.Mesh(np.zeros((6, 2)), [("triangle6", [[*range(6)]])])]
)
def test_meshes_of_second_order_are_refused_with_the_cure(data):
    """Their edges may be curved. Control: the linear part, as the message says, is read."""
    with sentences.raises(ul.InputError):
        ul.mesh(data)
    mesh = skfem.MeshTri2().refined(1)
    assert ul.mesh(skfem.MeshTri(mesh.p[:, : mesh.nvertices], mesh.t)).n_nodes == 9


def test_slight_corners_are_told():
    """Of a mesh that was rounded to 4 decimals and scaled afterwards, so that its numbers do not show it.

    Without a word it would have more sides than four. Control: nothing is told of the mesh as it was.
    """
    strip = skfem.MeshTri.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 0.3, 9))
    turn = np.array([[np.cos(0.01), np.sin(0.01)], [-np.sin(0.01), np.cos(0.01)]])
    assert ul.mesh(strip.p.T @ turn, strip.t.T).polygon.n_sides == 4
    with pytest.warns(ul.SolutionWarning, match="turn by less than 1 degree, the first at .* by polygon="):
        scaled = ul.mesh(np.round(strip.p.T @ turn, 4) * 0.0254, strip.t.T)
    assert scaled.polygon.n_sides > 4
