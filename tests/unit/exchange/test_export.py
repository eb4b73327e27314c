"""A case as files: what they say is what the case is, and bad input leaves nothing behind."""

import json
import re
from pathlib import Path

import meshio
import numpy as np
import pandas as pd
import pytest
import sentences
import xarray as xr
from conftest import load

import unilateral as ul
from unilateral.cli import main
from unilateral.errors import StorageError
from unilateral.exchange import export as exporting
from unilateral.exchange.boundary_function import obstacle_at_nodes
from unilateral.exchange.case_formulas import DEFINITIONS, derive_case_formulas
from unilateral.exchange.export import LEVEL_FILES, export_case
from unilateral.exchange.exported_folder import read_exported_folder
from unilateral.fem.p1 import case_moments, load_vector
from unilateral.geometry import files, polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems import case as cases


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """`natural` on two levels, h = 1/4 and 1/8, H = 2h."""
    exported = tmp_path_factory.mktemp("export") / "natural"
    arguments = ["--h", "1/8", "--H", "1/4", "--levels", "2", "--out", str(exported)]
    assert main(["export", "natural", *arguments]) == 0
    return exported


def test_what_is_written_is_told_a_line_for_each_folder(run, tmp_path):
    code, out, err = run("export", "natural", "--h", "1/8", "--H", "1/4", "--out", tmp_path / "new")
    assert (code, err) == (0, "")
    first, *lines = out.splitlines()
    assert first == f"natural: 1 level in {tmp_path / 'new'}"
    groups = [re.fullmatch(r"  (.*): (.*); \S+ kB", line).groups() for line in lines]
    assert {Path(folder_name) / name for folder_name, names in groups for name in names.split(", ")} == {
        file for file in (tmp_path / "new").rglob("*") if file.is_file()
    }


def test_a_case_without_closed_formulas_says_so():
    """A Cantor family is no single formula."""
    assert derive_case_formulas(load("violates_jjj"))["u"] is None


def test_every_level_has_its_files(folder):
    problem = json.loads((folder / "problem.json").read_text())
    assert [level["h"] for level in problem["levels"]] == [1 / 4, 1 / 8]
    assert [level["H"] for level in problem["levels"]] == [1 / 2, 1 / 4]
    assert problem["lambda_is_a_fractional_power_at"] == [{"side": 0, "t": 0.5, "place": [0.5, 0.0]}]
    for level in problem["levels"]:
        assert {file.name for file in (folder / level["folder"]).iterdir()} == set(LEVEL_FILES)
        assert f"| {level['folder']} |" in (folder / "README.md").read_text()
    assert cases.load_solution(folder / "natural.yaml", polygon.square()).name == "natural"


def test_both_mesh_files_hold_the_same_mesh(folder):
    read = meshio.read(folder / "level_1" / "mesh.msh")
    other_read = meshio.read(folder / "level_1" / "mesh.vtu")
    np.testing.assert_array_equal(read.points, other_read.points)
    np.testing.assert_array_equal(read.cells_dict["triangle"], other_read.cells_dict["triangle"])
    sides = other_read.cell_data_dict["side"]["line"]
    np.testing.assert_array_equal(read.cell_data_dict["gmsh:physical"]["line"], sides + 1)


def test_the_quadrature_gives_the_load_and_the_means_of_g(folder):
    """By this project's own load, and the means in partition.csv; a point too few would show."""
    level = folder / "level_1"
    case = load("natural")
    mesh = files.read_mesh(level / "mesh.vtu", case.polygon)
    rule = xr.load_dataset(level / "quadrature.nc")
    nodes = pd.read_csv(level / "nodes.csv")
    moments = np.zeros((len(mesh.triangles), 3))
    weighted = (rule.weight * rule.f).values[:, None] * rule.barycentric.values
    np.add.at(moments, rule.triangle.values, weighted)
    expected = load_vector(mesh, case_moments(case, mesh))
    np.testing.assert_allclose(load_vector(mesh, moments), expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(nodes.load, expected, rtol=1e-12, atol=1e-14)
    cells = pd.read_csv(level / "partition.csv")
    cell = np.searchsorted(cells.start, rule.s.values, side="right") - 1
    integrals = np.bincount(cell, (rule.boundary_weight * rule.g).values)
    np.testing.assert_allclose(integrals / (cells.end - cells.start), cells.g_mean, rtol=1e-12)


def test_a_mesh_of_ones_own_is_the_coarsest_level(tmp_path):
    original = make_structured_mesh(polygon.square(), 1 / 3)
    files.write_mesh(original, tmp_path / "own.msh")
    options = ["--H", "1/3", "--levels", "2", "--out", str(tmp_path / "out")]
    assert main(["export", "full_contact", "--mesh", str(tmp_path / "own.msh"), *options]) == 0
    levels = json.loads((tmp_path / "out/problem.json").read_text())["levels"]
    assert [(level["nodes"], level["cells"]) for level in levels] == [(16, 8), (49, 12)]


def test_a_mesh_without_triangles_is_refused_in_words(tmp_path, refusal):
    """Only lines; and a file without anything, on which meshio gives up: its words stand in brackets."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.0]])
    lines = [("line", np.array([[0, 1], [1, 2], [2, 0]]))]
    meshio.write(tmp_path / "lines.vtu", meshio.Mesh(corners, lines))
    meshio.write(tmp_path / "empty.vtk", meshio.Mesh(np.zeros((0, 3)), []))
    words = {"lines.vtu": "there are no triangles", "empty.vtk": "has not the format of its ending"}
    for name, word in words.items():
        options = ["--mesh", tmp_path / name, "--H", "1/2", "--out", tmp_path / "out"]
        error = re.sub(r"\(meshio .*\)", "", refusal("export", "natural", *options))
        assert word in error
        assert "shape" not in error
        assert "index" not in error


POLYGON = "polygon: [[0, 0], [2, 0], [1/2, 3/2], [-1, 1]]\n"


def test_a_case_on_a_polygon_of_ones_own_with_free_sides(tmp_path, capsys):
    """Its files say the polygon and the side; nothing is asked of the free sides, and the case is read again.

    Its own solution of what is read scores without a fault. One that held g on the free sides, too, would be
    another one where the case has no contact but g were not below u.
    """
    (tmp_path / "own.yaml").write_text(POLYGON)
    options = ["--polygon", str(tmp_path / "own.yaml"), "--free-sides", "2,3", "--h", "1/8", "--H", "1/4"]
    folder = str(tmp_path / "out")
    assert main(["export", "thirds", *options, "--levels", "2", "--out", folder]) == 0
    case, levels = read_exported_folder(folder)
    np.testing.assert_array_equal(case.polygon.vertices, [[0, 0], [2, 0], [0.5, 1.5], [-1, 1]])
    assert (case.exact.side, case.free_sides) == (0, (2, 3))
    assert "On the sides 2, 3 there is no obstacle" in (tmp_path / "out/README.md").read_text()
    nodes = pd.read_csv(f"{folder}/level_1/nodes.csv")
    cells = pd.read_csv(f"{folder}/level_1/partition.csv")
    vertices = case.polygon.starts
    assert nodes.g[nodes.s == 0].notna().all()  # between side 3, free, and side 0
    assert nodes.g[nodes.s > vertices[2]].isna().all()
    assert nodes.g[nodes.s <= vertices[2]].notna().all()
    assert (cells.g_mean.isna() == cells.side.isin([2, 3])).all()
    solved = ul.solve(case, H=levels[1].partition.H, mesh=levels[1].mesh)
    solved.save(tmp_path / "solution.nc")
    assert main(["score", folder, str(tmp_path / "solution.nc"), "--json"]) == 0
    (record,) = json.loads(capsys.readouterr().out.splitlines()[-1])["solutions"]
    assert (record["faults"], record["level"]) == ([], "level_1")
    assert record["errors"]["h1"] == pytest.approx(solved.errors.h1, rel=1e-12)


@pytest.mark.parametrize("free", [(0,), (2,), (3,), (0, 3), (1, 3)])
def test_g_is_asked_for_at_the_ends_of_held_sides(free):
    """Of `no_contact`, by its formula on each side; between two free sides and inside them there is none."""
    case = ul.case("no_contact", "square", 0, free)
    mesh = make_structured_mesh(polygon.square(), 1 / 4)
    names = {}
    case_formulas = derive_case_formulas(case.exact)
    exec(DEFINITIONS, names)
    for node, g in zip(mesh.points[mesh.boundary], obstacle_at_nodes(case, mesh), strict=True):
        x, y = node
        sides = [i for i, on_side in enumerate((y == 0, x == 1, y == 1, x == 0)) if on_side and i not in free]
        values = [eval(case_formulas["g"][i], {**names, "x": x, "y": y}) for i in sides]
        assert (not values and np.isnan(g)) or all(g == pytest.approx(value, abs=1e-14) for value in values)


def test_a_side_is_where_the_case_is(tmp_path):
    """`thirds` on side 4 of the L-shape, which is 2 long, has its contact from 1/3 to 7/12 of that."""
    options = ("--polygon", "lshape", "--side", "4", "--h", "1/4", "--H", "1/2")
    assert main(["export", "thirds", *options, "--out", str(tmp_path / "out")]) == 0
    case, _ = read_exported_folder(tmp_path / "out")
    t = np.array([0.3, 0.4, 0.57, 0.6])
    _, flux, _ = case.exact.trace_flux_and_gap(np.full(4, 4), 2 * t)
    assert (flux > 1e-9).tolist() == [False, True, True, False]  # but for rounding
    problem = json.loads((tmp_path / "out/problem.json").read_text())
    assert {point["side"] for point in problem["lambda_is_a_fractional_power_at"]} == {4}


def test_a_folder_that_is_there_is_not_touched(folder, refusal):
    before = sorted(folder.iterdir())
    message = refusal("export", "natural", "--h", "1/4", "--H", "1/2", "--out", folder)
    assert "exists already" in message
    assert sorted(folder.iterdir()) == before


def test_a_failure_midway_leaves_nothing(tmp_path, monkeypatch):
    """The second level's cells cannot be written."""
    monkeypatch.setattr(
        "unilateral.exchange.export.make_cell_columns", lambda cells, **_: 1 / (cells.n_cells - 8)
    )
    with pytest.raises((ZeroDivisionError, AttributeError)):
        export_case(
            load("natural").problem, make_structured_mesh(polygon.square(), 1 / 4), 1 / 4, 2, tmp_path / "out"
        )
    assert not list(tmp_path.iterdir())


def test_of_two_exports_into_one_folder_the_slower_one_is_refused(tmp_path, refusal, monkeypatch):
    """The quicker one's folder appears while the slower one writes."""
    out = tmp_path / "out"
    write = exporting._write_folder

    def write_first(*arguments):
        write(*arguments)
        out.mkdir()
        (out / "problem.json").write_text("{}")

    monkeypatch.setattr(exporting, "_write_folder", write_first)
    message = refusal("export", "natural", "--h", "1/4", "--H", "1/2", "--out", out)
    assert message == f"unilateral: {out} exists already; name a new folder\n"
    assert [file.name for file in (*tmp_path.iterdir(), *out.iterdir())] == ["out", "problem.json"]


def test_a_full_disk_is_told_of_the_file_that_was_to_be_there(tmp_path, monkeypatch):
    """Not of the hidden one."""

    def full(_, path):
        raise StorageError(f"{path} cannot be written: No space left on device")

    monkeypatch.setattr(exporting, "write_mesh", full)
    with sentences.raises(StorageError, f"{tmp_path}/out/level_0/mesh.msh"):
        export_case(
            load("natural").problem, make_structured_mesh(polygon.square(), 1 / 4), 1 / 4, 1, tmp_path / "out"
        )
    assert not list(tmp_path.iterdir())
