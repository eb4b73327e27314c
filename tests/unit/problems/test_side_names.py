"""Sides by their names: those of a problem file, of a polygon, and of the curves of a mesh."""

import meshio
import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.errors import InputError

CORNERS = [(0, 0), (2, 0), (2, 1), (0, 1)]
MESH = ul.mesh(CORNERS, [(0, 1, 2), (0, 2, 3)], halvings=2)
NAMES = {"seat": 0, "rest": [1, 2], "clamp": 3}
FIELDS = "f: -1\nc: 0\ng: {seat: -1/10}\nu: {clamp: 0}\nfree_sides: [rest]\n"


def write_mesh(path, points=MESH.points, curves=("seat", "lid", "inside")):
    """A mesh of a rectangle with names: of the left half of its bottom, of two sides, and of lines inside."""
    edges = np.column_stack([MESH.boundary, np.roll(MESH.boundary, -1)])
    middle = MESH.points[edges].mean(axis=1)
    inside = np.column_stack([MESH.triangles[:, 0], MESH.triangles[:, 1]])
    on_curves = {
        "seat": edges[(middle[:, 1] == 0) & (middle[:, 0] < 1)],
        "lid": edges[(middle[:, 0] == 2) | (middle[:, 1] == 1)],
        "inside": inside[[not {*pair} <= {*MESH.boundary.tolist()} for pair in inside.tolist()]],
    }
    lines = np.concatenate([on_curves[name] for name in curves])
    tags = np.repeat(np.arange(len(curves)) + 1, [len(on_curves[name]) for name in curves])
    groups = [tags, np.full(len(MESH.triangles), 9)]
    content = meshio.Mesh(
        np.column_stack([points, np.zeros(len(points))]),
        [("line", lines), ("triangle", MESH.triangles)],
        cell_data={"gmsh:physical": groups, "gmsh:geometrical": groups},
        field_data={name: np.array([i + 1, 1]) for i, name in enumerate(curves)}
        | {"sheet": np.array([9, 2])},
    )
    meshio.write(path, content, file_format="gmsh22", binary=False)


def write_problem(folder, polygon, fields=FIELDS):
    file = folder / "own.yaml"
    file.write_text(f"polygon: {polygon}\n{fields}")
    return file


def test_names_stand_for_sides_in_every_field(tmp_path):
    """Bit for bit; a name may be that of several sides, and g, u, q and free sides take it."""
    by_number = ul.Problem(
        CORNERS, -1, ["-1/10", None, None, None], free_sides=[1, 2], c=0, u={3: 0}, q=[None, "y", "y", None]
    )
    polygon = ul.Polygon(CORNERS, "part", NAMES)
    by_name = ul.Problem(
        polygon, -1, {"seat": "-1/10"}, free_sides=["rest"], c=0, u={"clamp": 0}, q={"rest": "y"}
    )
    text = "[[0, 0], [2, 0], [2, 1], [0, 1]]\nside_names: {seat: 0, rest: [1, 2], clamp: 3}\nq: {rest: y}"
    from_file = ul.load(write_problem(tmp_path, text))
    expected = ul.solve(by_number, h=1 / 8, H=1 / 4)
    for problem in (by_name, from_file):
        s = ul.solve(problem, h=1 / 8, H=1 / 4)
        assert s.bounds == expected.bounds
        assert s.force(sides=["seat"]) == expected.force(sides=[0])
        assert s.force(sides=["rest", "clamp"]) == expected.force(sides=[1, 2, 3])
        np.testing.assert_array_equal(s.lambda_at("seat", [0.3]), expected.lambda_at(0, [0.3]))
    assert "clamped sides = 3 (clamp), " in repr(by_name)
    assert "free sides = 1 (rest), 2 (rest)" in repr(by_name)


def test_the_outline_of_a_mesh_has_the_names_of_its_curves(tmp_path):
    """A straight side ends where a name does; a curve inside names nothing, nor does a group of triangles."""
    write_mesh(tmp_path / "part.msh")
    for polygon in (
        ul.load(write_problem(tmp_path, "part.msh", "f: -1\ng: 0\n")).polygon,
        ul.Problem(polygon=tmp_path / "part.msh", f=-1, g=0).polygon,
        ul.mesh(tmp_path / "part.msh").polygon,
    ):
        assert polygon.vertices.tolist() == [[0, 0], [1, 0], [2, 0], [2, 1], [0, 1]]
        assert polygon.side_names == {"seat": (0,), "lid": (2, 3)}
    # control: without names the bottom is one side
    write_mesh(tmp_path / "part.msh", curves=["inside"])
    assert ul.mesh(tmp_path / "part.msh").polygon.n_sides == 4


def test_names_of_rounded_meshes_are_found_and_their_mesh_is_refined(tmp_path, recwarn):
    """The mesh is turned and rounded, so that the end of a name is beside the straight line."""
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    write_mesh(tmp_path / "part.msh", np.round(MESH.points @ turn, 9))
    fields = "f: -1\ng: {seat: -1/10, lid: -1/10}\nside_names: {rest: [1, 4]}\nfree_sides: [rest]\n"
    problem = ul.load(write_problem(tmp_path, "part.msh", fields))
    assert problem.polygon.side_names == {"seat": (0,), "lid": (2, 3), "rest": (1, 4)}
    mesh = ul.mesh(tmp_path / "part.msh", polygon=problem)
    assert ul.solve(problem, mesh=mesh, accuracy=0.2).certified
    assert not any("vertex turns" in str(warning.message) for warning in recwarn)


def test_a_mesh_with_a_hole_is_refused(tmp_path):
    """A square ring of eight triangles."""
    points = [(0, 0), (3, 0), (3, 3), (0, 3), (1, 1), (2, 1), (2, 2), (1, 2)]
    ring = [(0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5), (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)]
    meshio.Mesh(np.column_stack([points, np.zeros(8)]), [("triangle", ring)]).write(tmp_path / "ring.vtu")
    with sentences.raises(InputError, "field polygon", "ring.vtu", "holes"):
        ul.load(write_problem(tmp_path, "ring.vtu"))


@pytest.mark.parametrize(
    "fields",
    [
        "g: {saet: 0}\nside_names: {seat: 0}",
        "g: 0\nfree_sides: [lid]\nside_names: {seat: 0}",
        "g: 0\nfree_sides: [lid]",
        "g: 0\nfree_sides: [seat, 0]\nside_names: {seat: 0}",
        "g: {seat: 0, 0: 0}\nside_names: {seat: [0, 1]}",
        "g: {seat:0}\nside_names: {seat: 0}",
        "g: 0\nu: {seat: 0}\nfree_sides: [rest]\nside_names: {seat: 0, rest: [0, 1]}",
        "g: [0, 0, 0, 1]\nside_names: {seat: 0, lid: 3}",
        "g: 0\nside_names: {seat: 4}",
        "g: 0\nside_names: {seat: []}",
        "g: 0\nside_names: {seat: left}",
        "g: 0\nside_names: {5: 0}",
        "side_names: {seat: 0}",
    ],
)
def test_names_that_stand_for_no_side_are_refused(tmp_path, fields):
    with sentences.raises(InputError, "own.yaml"):
        ul.load(write_problem(tmp_path, "[[0, 0], [2, 0], [2, 1], [0, 1]]", f"f: -1\n{fields}\n"))


def test_commands_print_names_beside_numbers(run, tmp_path):
    text = "[[0, 0], [2, 0], [2, 1], [0, 1]]\nside_names: {seat: 0, rest: [1, 2], clamp: 3}"
    file = write_problem(tmp_path, text)
    code, out, err = run("check", file)
    assert (code, err) == (0, "")
    assert "  side 3 (clamp) (0, 1) to (0, 0), length 1: clamped, u = 0\n" in out
    code, out, err = run("solve", file, "--h", "1/8", "--H", "1/4")
    assert (code, err) == (0, "")
    for row in ("contact, side 0 (seat)", "force, side 0 (seat)", "reaction, side 3 (clamp)"):
        assert f"  {row} " in out
    outputs = [
        run("solve", file, "--accuracy", "0.2", "--norm", "force", "--sides", sides)[1]
        for sides in ("seat, clamp", "0,3")
    ]
    rows = [text.partition("  time and memory")[0] for text in outputs]
    assert "side 0 (seat)" in rows[0]
    assert rows[0] == rows[1]
