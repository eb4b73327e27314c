"""Meshes in files: what is written is read again, and what is no mesh is refused in words."""

import re

import gmsh
import meshio
import numpy as np
import pytest
import sentences
from nested import SLANTED
from numpy.testing import assert_array_equal

from unilateral.errors import InputError
from unilateral.geometry import files
from unilateral.geometry.files import read_mesh, write_mesh
from unilateral.geometry.mesh import make_unstructured_mesh, refine_uniformly
from unilateral.geometry.outline import find_outline
from unilateral.geometry.polygon import Polygon, find_polygon, square
from unilateral.geometry.structured import make_structured_mesh

MESHES = {
    "thirds": lambda: make_structured_mesh(square(), 1 / 3),
    "lshape": lambda: make_structured_mesh(find_polygon("lshape"), 1 / 4),
    "gmsh": lambda: make_unstructured_mesh(SLANTED, 0.4),
    "gmsh refined": lambda: refine_uniformly(make_unstructured_mesh(SLANTED, 0.7)),
    "far": lambda: make_unstructured_mesh(Polygon(SLANTED.vertices + np.array([1e4, -3e3]), "far"), 0.5),
    "tiny": lambda: refine_uniformly(make_unstructured_mesh(Polygon(1e-9 * SLANTED.vertices, "tiny"), 4e-10)),
}


@pytest.mark.parametrize("name", MESHES)
def test_files_keep_every_bit(name, tmp_path):
    mesh = MESHES[name]()
    write_mesh(mesh, tmp_path / "mesh.vtu")
    again = read_mesh(tmp_path / "mesh.vtu", mesh.polygon)
    for name in ("points", "triangles", "boundary", "s", "side"):
        assert_array_equal(getattr(again, name), getattr(mesh, name))


@pytest.mark.parametrize("ending", ["vtu", "vtk", "mesh", "inp"])
def test_every_format_keeps_the_points(ending, tmp_path):
    mesh = make_structured_mesh(find_polygon("lshape"), 1 / 4)
    write_mesh(mesh, tmp_path / f"mesh.{ending}")
    assert_array_equal(read_mesh(tmp_path / f"mesh.{ending}", find_polygon("lshape")).points, mesh.points)


def test_writing_twice_gives_the_same_bytes_and_nothing_else(tmp_path):
    mesh = make_unstructured_mesh(find_polygon("lshape"), 0.3)
    (tmp_path / "b.vtu").write_text("an older file")
    write_mesh(mesh, tmp_path / "a.vtu")
    write_mesh(mesh, tmp_path / "b.vtu")
    assert (tmp_path / "a.vtu").read_bytes() == (tmp_path / "b.vtu").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.vtu", "b.vtu"]


def test_files_carry_the_sides(tmp_path):
    """The square with two triangles: its boundary edges are its sides, in order; triangles carry -1."""
    write_mesh(make_structured_mesh(square(), 1), tmp_path / "mesh.vtu")
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


CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
LIFTED = [[0, 0, 0.1], [1, 0, 0], [1, 1, 0], [0, 1, 0]]


@pytest.mark.parametrize(
    ("points", "cells"),
    [
        (LIFTED, ("triangle", [[0, 1, 2], [0, 2, 3]])),
        (CORNERS, ("quad", [[0, 1, 2, 3]])),
        (CORNERS, ("line", [[0, 1]])),
    ],
)
def test_files_of_something_else_are_refused(points, cells, tmp_path):
    meshio.Mesh(np.array(points, dtype=float), [cells]).write(tmp_path / "mesh.vtu")
    with sentences.raises(InputError):
        read_mesh(tmp_path / "mesh.vtu", square())


@pytest.mark.parametrize("number", [-6, 9])
def test_a_node_that_the_file_has_not_is_refused(number, monkeypatch):
    """By its number in the file, which has a node of no triangle, too."""
    content = meshio.Mesh(
        np.array([*CORNERS, [0.5, 0.5, 0]], dtype=float), [("triangle", [[0, 1, 2], [0, number, 3]])]
    )
    monkeypatch.setattr(files, "read_with_meshio", lambda path: content)
    with sentences.raises(InputError, str(number)):
        read_mesh("mesh.vtu", square())


NONE_2_2 = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n0\n$EndNodes\n"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("missing.vtu", None),
        *((name, "this is no mesh") for name in ("g.vtu", "g.msh", "mesh.nothing")),
        ("header.msh", "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"),
        ("empty.inp", ""),
        ("title.inp", "*HEADING\nsquare\n*NODE\n"),
        ("nodes.inp", "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n"),
        ("cut.inp", "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n*ELEMENT, TYPE=S3\n"),
        ("none.msh", NONE_2_2),
        ("empty.msh", ""),
        ("cut.vtk", "# vtk"),
    ],
)
def test_files_without_a_mesh_are_refused(name, content, tmp_path, capfd):
    """In one sentence; what a library says of it stands in brackets behind our words."""
    if content is not None:
        (tmp_path / name).write_text(content)
    with sentences.raises(InputError, name) as refused:
        read_mesh(tmp_path / name, square())
    original = re.sub(r"\(meshio .*\)", "", str(refused.value))
    assert not re.search("array|shape|index|identity|expected|block", original)
    assert "\n" not in str(refused.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("ending", ["vtu", "vtk", "msh", "mesh", "inp", "stl", "avs"])
def test_cut_off_files_are_refused(ending, tmp_path):
    """After any tenth of it a file is no mesh of the square, and is told so with its name."""
    write_mesh(make_structured_mesh(square(), 1 / 2), tmp_path / f"whole.{ending}")
    content = (tmp_path / f"whole.{ending}").read_bytes()
    for tenths in range(10):
        (tmp_path / f"cut.{ending}").write_bytes(content[: len(content) * tenths // 10])
        with pytest.raises(InputError, match=rf"cut\.{ending}: "):
            read_mesh(tmp_path / f"cut.{ending}", square())


def test_an_unknown_format_is_not_written(tmp_path):
    with pytest.raises(InputError, match="nothing: the mesh cannot be written there"):
        write_mesh(make_structured_mesh(square(), 1), tmp_path / "mesh.nothing")
    assert not list(tmp_path.iterdir())


def test_a_file_s_own_outline_is_a_polygon(tmp_path):
    """Of the L-shape, by its corners only; a square with a hole is refused."""
    write_mesh(make_structured_mesh(find_polygon("lshape"), 1 / 3), tmp_path / "l.vtu")
    polygon = read_mesh(tmp_path / "l.vtu").polygon
    assert polygon.n_sides == 6
    assert polygon.area == pytest.approx(3)
    ring = make_structured_mesh(square(), 1 / 3)
    retained = ~np.all(np.abs(ring.points[ring.triangles].mean(axis=1) - 0.5) < 1 / 6, axis=1)
    with sentences.raises(InputError):
        find_outline(ring.points, ring.triangles[retained], "ring")
