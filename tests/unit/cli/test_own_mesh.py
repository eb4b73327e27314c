"""Meshes in files, as commands read them."""

import numpy as np
import pytest
from typed import PROBLEM

from unilateral.geometry.files import write_mesh
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.geometry.polygon import Polygon

pytestmark = pytest.mark.usefixtures("shared_cases")

TURN = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
TURNED = Polygon(np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) @ TURN, "turned")


@pytest.mark.parametrize("content", ["", "5 2 0 0\n1 0 0\n"])
@pytest.mark.parametrize(
    "command",
    [
        ("solve", PROBLEM, "--H", "1", "--mesh"),
        ("infsup", "--cells", "2", "--mesh"),
        ("export", "natural", "--H", "1/2", "--out", "out", "--mesh"),
        ("score", "exported"),
    ],
    ids=lambda command: command[0],
)
def test_files_that_hold_no_triangles_are_refused_at_once(
    command, content, refusal, run, tmp_path, monkeypatch
):
    """meshio's reader of .ele goes on for ever where the file is empty."""
    monkeypatch.chdir(tmp_path)
    if command[0] == "score":
        assert run("export", "natural", "--h", "1/4", "--H", "1/2", "--out", "exported")[0] == 0
    for name in ("e.node", "e.ele"):
        (tmp_path / name).write_text(content)
    message = refusal(*command, "e.ele")
    assert "e.ele: " in message
    assert ("the file is empty" if not content else "files of Triangle and TetGen are not read") in message
    assert not (tmp_path / "out").exists()


def write_rounded_mesh(folder, decimals):
    """A mesh of the turned square in a file, with few decimals."""
    mesh = make_unstructured_mesh(TURNED, 1 / 8)
    points = np.round(mesh.points, decimals)
    lines = [f"{i} {x!r} {y!r} 0" for i, (x, y) in enumerate(points.tolist(), start=1)]
    cells = [f"{i} 2 2 1 1 {a} {b} {c}" for i, (a, b, c) in enumerate((mesh.triangles + 1).tolist(), start=1)]
    head = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n"
    text = [head + str(len(lines)), *lines, "$EndNodes\n$Elements", str(len(cells)), *cells, "$EndElements\n"]
    (folder / "own.msh").write_text("\n".join(text))
    return str(folder / "own.msh")


def test_turns_that_are_taken_for_rounding_are_told_on_standard_error(run, tmp_path):
    """infsup reports the beta of four sides. Control: in full precision nothing is told."""
    code, out, err = run("infsup", "--mesh", write_rounded_mesh(tmp_path, 6), "--cells", "4")
    assert code == 0
    assert out.startswith("own, 4 sides: h = 0.125")
    assert "own.msh: the polygon has 4 sides; the turns of its boundary at" in err
    assert err.count("\n") == 1
    write_mesh(make_unstructured_mesh(TURNED, 1 / 8), tmp_path / "exact.vtu")
    code, exact, err = run("infsup", "--mesh", str(tmp_path / "exact.vtu"), "--cells", "4")
    assert (code, err) == (0, "")
    assert [line for line in out.splitlines() if "beta in" in line] == [
        line for line in exact.splitlines() if "beta in" in line
    ]


def test_the_polygon_is_asked_for_by_the_option(refusal, run, tmp_path):
    message = refusal("infsup", "--mesh", write_rounded_mesh(tmp_path, 3), "--cells", "4")
    assert "it is not clear whether there is a corner; give the polygon, by --polygon" in message
    (tmp_path / "turned.yaml").write_text(f"polygon: {TURNED.vertices.tolist()}")
    assert (
        run(
            "infsup",
            "--mesh",
            write_rounded_mesh(tmp_path, 3),
            "--cells",
            "4",
            "--polygon",
            str(tmp_path / "turned.yaml"),
        )[0]
        == 0
    )
