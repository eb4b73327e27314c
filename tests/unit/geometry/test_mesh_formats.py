"""The table of formats in docs/python.md, row by row: a file of each kind is written, and read or refused."""

import re
from contextlib import redirect_stderr, redirect_stdout
from importlib.util import find_spec
from io import StringIO

import gmsh
import meshio
import numpy as np
import pytest
import sentences
from conftest import ROOT

import unilateral as ul
from unilateral.geometry import files

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.4, 0.6, 0]])
TRIANGLES = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def table():
    """The first two cells of each row."""
    text = (ROOT / "docs/python.md").read_text(encoding="utf-8")
    begin = text.index("| file | is it read?")
    rows = [line.split("|")[1:3] for line in text[begin : text.index("\n\n", begin)].splitlines()[2:]]
    return {file.strip(): read.strip() for file, read in rows}


def write_by_meshio(ending, kind, **options):
    def write(folder):
        path = folder / f"square{ending}"
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            meshio.write(path, meshio.Mesh(POINTS, [("triangle", TRIANGLES)]), kind, **options)
        return path

    return write


def write_by_gmsh(ending, binary=0, groups=0, version=4.1):
    """The square in two halves, each of which is in so many physical groups, all in the last."""

    def write(folder):
        path = folder / f"square{ending}"
        gmsh.initialize(readConfigFiles=False, interruptible=False)
        try:
            for option, value in {"General.Terminal": 0, "Mesh.Binary": binary}.items():
                gmsh.option.setNumber(option, value)
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
            gmsh.model.occ.synchronize()
            gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
            gmsh.model.mesh.generate(2)
            for _ in range(groups):
                gmsh.model.addPhysicalGroup(2, [1])
            gmsh.write(str(path))
        finally:
            gmsh.finalize()
        return path

    return write


def write_by_hand(name, text):
    def write(folder):
        (folder / name).write_text(text)
        return folder / name

    return write


def lines(*numbers):
    return "".join(" ".join(map(str, line)) + "\n" for line in numbers)


def number_rows(rows, *, extra=()):
    return [[i, *row, *extra] for i, row in enumerate(rows, start=1)]


MSH = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n5\n{}$EndNodes\n$Elements\n{}\n{}$EndElements\n"
ELEMENTS = lines(*[[i, 2, 2, 1, 1, *row] for i, row in enumerate((TRIANGLES + 1).tolist(), start=1)])
COMMAS = MSH.format(lines(*number_rows(POINTS.tolist())).replace(".", ","), 4, ELEMENTS)
FREEFEM = lines(
    [5, 4, 4], *[[x, y, 0] for x, y, _ in POINTS], *[[*row, 0] for row in (TRIANGLES + 1).tolist()]
)
NODES = lines([5, 2, 0, 0], *number_rows(POINTS[:, :2].tolist()))
ELE = lines([4, 3, 0], *number_rows((TRIANGLES + 1).tolist()))


def triangle(ending):
    def write(folder):
        (folder / "square.node").write_text(NODES)
        (folder / "square.ele").write_text(ELE)
        return folder / f"square{ending}"

    return write


XDMF = """<Xdmf Version="3.0"><Domain><Grid><Geometry GeometryType="XYZ">
<DataItem DataType="Float" Dimensions="5 3" Format="HDF" Precision="8">square.h5:/data0</DataItem>
</Geometry></Grid></Domain></Xdmf>"""
GZ = (".gz", "")
WRITERS = {
    "`.msh` of Gmsh 2.2 or 4.1, text or binary": [
        write_by_gmsh(".msh", binary, version=version) for binary in (0, 1) for version in (2.2, 4.1)
    ],
    "`.msh` of Ansys Fluent": [write_by_meshio(".msh", "ansys")],
    "`.msh` of FreeFEM": [write_by_hand("square.msh", FREEFEM)],
    "`.msh` with decimal commas": [write_by_hand("square.msh", COMMAS)],
    "`.mesh`, `.meshb` of Medit or FreeFEM": [write_by_meshio(end, "medit") for end in (".mesh", ".meshb")],
    "`.vtu`, `.vtk`": [write_by_meshio(".vtu", "vtu"), write_by_meshio(".vtk", "vtk"), write_by_gmsh(".vtk")],
    "`.vtk` of Gmsh, binary, with physical groups": [write_by_gmsh(".vtk", binary=1, groups=1)],
    "`.inp` of Abaqus": [write_by_meshio(".inp", "abaqus"), write_by_gmsh(".inp")],
    "`.bdf`, `.fem`, `.nas` of Nastran": [
        write_by_meshio(end, "nastran") for end in (".bdf", ".fem", ".nas")
    ],
    "`.bdf` of Gmsh": [write_by_gmsh(".bdf")],
    "`.e`, `.exo`, `.ex2` of Exodus": [write_by_meshio(end, "exodus") for end in (".e", ".exo", ".ex2")],
    "`.su2`": [write_by_gmsh(".su2")],
    "`.vol`, `.vol.gz` of Netgen": [write_by_meshio(f".vol{gz}", "netgen") for gz in GZ],
    "`.xml` of DOLFIN": [write_by_meshio(".xml", "dolfin-xml")],
    "`.dat`, `.tec` of Tecplot": [write_by_meshio(end, "tecplot") for end in (".dat", ".tec")],
    "`.avs`, `.mdpa`, `.obj`, `.off`, `.ply`, `.stl`": [
        write_by_meshio(".avs", "avsucd"),
        *(write_by_meshio(f".{kind}", kind) for kind in ("mdpa", "obj", "off", "ply", "stl")),
    ],
    "`.dato`, `.dato.gz`, `.post`, `.post.gz` of Permas": [
        write_by_meshio(f".{end}{gz}", "permas") for end in ("dato", "post") for gz in GZ
    ],
    "`.xdmf`, `.xmf`, `.h5m`, `.hmf`, `.med`": [
        write_by_meshio(end, end[1:].replace("xmf", "xdmf"))
        for end in (".xdmf", ".xmf", ".h5m", ".hmf", ".med")
    ],
    "`.node`, `.ele` of Triangle or TetGen": [triangle(".node"), triangle(".ele")],
    "`.cgns`, `.svg`, `.ugrid`, `.wkt`": [
        write_by_hand("square.cgns", "CGNS"),
        *(write_by_meshio(f".{kind}", kind) for kind in ("svg", "ugrid", "wkt")),
    ],
    "`.unv` and any other ending": [write_by_gmsh(".unv"), write_by_hand("square.nothing", "mesh")],
}
FILES = [
    pytest.param(row, write, id=f"{row} {i}") for row, item in WRITERS.items() for i, write in enumerate(item)
]


def test_the_table_has_the_rows_that_are_tried():
    assert [*table()] == [*WRITERS]


@pytest.mark.parametrize(("row", "write"), FILES)
def test_what_the_table_says_of_a_format_is_true(row, write, tmp_path):
    message = table()[row]
    if message.startswith("if h5py") and not find_spec("h5py"):
        with pytest.raises(ModuleNotFoundError, match="h5py"):  # for writing; see the next test
            write(tmp_path)
        return
    path = write(tmp_path)
    if message == "no":
        with pytest.raises(ul.InputError, match=re.escape(str(path))) as refused:
            ul.mesh(path)
        assert "\n" not in str(refused.value)
        assert "save the mesh as .msh of Gmsh or as .vtu" in str(refused.value)
        return
    mesh = ul.mesh(path)
    assert mesh.polygon.n_sides == 4
    assert mesh.areas.sum() == pytest.approx(1, abs=1e-6)  # some writers take 7 digits


@pytest.mark.skipif(find_spec("h5py") is not None, reason="h5py is installed")
@pytest.mark.parametrize("name", ["square.xdmf", "square.h5m", "square.hmf", "square.med"])
def test_a_missing_package_is_named_with_the_line_to_type(name, tmp_path):
    (tmp_path / name).write_text(XDMF)
    with sentences.raises(ul.InputError, name):
        ul.mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("square.msh", FREEFEM),
        ("square.msh", COMMAS),
        ("square.bdf", "GRID,1"),
        ("square.off", "5 4 0"),
        ("square.ele", ""),
    ],
)
def test_what_is_wrong_with_a_file_is_told(name, text, tmp_path):
    (tmp_path / name).write_text(text)
    with sentences.raises(ul.InputError):
        ul.mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("kind", "component"), [("off", 0.05), ("mdpa", 0.2), ("ply", 0.15), ("tecplot", 0.65)]
)
def test_a_reader_that_does_not_end_is_given_up(kind, component, tmp_path, monkeypatch):
    """These readers of meshio wait for a line that a cut file has not. Control: the whole file is read."""
    monkeypatch.setattr(files, "READER_SECONDS", 0.2)
    path = write_by_meshio(".dat" if kind == "tecplot" else f".{kind}", kind)(tmp_path)
    content = path.read_bytes()
    assert ul.mesh(path).n_nodes == 5
    path.write_bytes(content[: int(component * len(content))])
    with sentences.raises(ul.InputError):
        ul.mesh(path)


def test_a_triangle_in_two_physical_groups_is_read_once(tmp_path):
    """Control: it is twice in the file."""
    path = write_by_gmsh(".msh", groups=2, version=2.2)(tmp_path)
    stored = meshio.read(path)
    listed = np.concatenate([block.data for block in stored.cells if block.type == "triangle"])
    mesh = ul.mesh(path)
    assert len(listed) == 2 * len(mesh.triangles)
    assert mesh.areas.sum() == pytest.approx(1)


def test_nodes_of_no_triangle_are_left_out_of_a_file_and_told(tmp_path):
    """As the centre of an arc, which gmsh saves. Arrays belong to all points, so there it is refused."""
    points = np.insert(POINTS, 0, [[7, 7, 0]], axis=0)
    triangles = TRIANGLES + 1
    meshio.Mesh(points, [("triangle", triangles), ("vertex", [[0]])]).write(tmp_path / "arc.vtu")
    with pytest.warns(
        ul.SolutionWarning, match=r"arc.vtu: 1 node of no triangle is left out, such as node 0 \(7, 7\)"
    ):
        mesh = ul.mesh(tmp_path / "arc.vtu")
    np.testing.assert_array_equal(mesh.points, POINTS[:, :2])
    np.testing.assert_array_equal(np.sort(mesh.triangles), np.sort(TRIANGLES))
    with sentences.raises(ul.InputError):
        ul.mesh(points, triangles)
