"""`certify` on the command line: files of other programs, and what is said of them."""

import json
import subprocess
import sys

import meshio
import numpy as np
import pytest
from conftest import ROOT

import unilateral as ul

pytestmark = pytest.mark.usefixtures("shared_cases")
PROBLEM = "polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: 3*x - 2\ng: -x*y/2\n"


def write(name, points, cells, at_nodes=None):
    """A file as other programs write it, with third coordinates."""
    meshio.write(name, meshio.Mesh(np.column_stack([points, 0 * points[:, 0]]), cells, at_nodes))


@pytest.fixture
def files(tmp_path, monkeypatch):
    """A problem file, its solution on a mesh as other programs write it, and the solution."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "p.yaml").write_text(PROBLEM, encoding="utf-8")
    s = ul.solve("p.yaml", h=1 / 8, H=1 / 4)
    cells = [("triangle", s.mesh.triangles)]
    write("mesh.vtu", s.mesh.points, cells)
    write("u.vtu", s.mesh.points, cells, {"uh": s.u})
    return s


def table(name, header, *columns):
    np.savetxt(name, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.17g")


def run_certify(run, *arguments):
    code, out, err = run("certify", "p.yaml", "--json", *arguments)
    return code, json.loads(out)["h1_bound"] if out else None, err


def test_the_only_field_of_a_vtu_is_certified_on_its_own_mesh(files, run):
    code, out, err = run("certify", "p.yaml", "--solution", "u.vtu")
    assert (code, err) == (0, "")
    assert out.startswith("p: h = 0.125, H = 0.25, h/H = 0.5\n")
    assert "  guaranteed                  ||u - u_h||_1 <= " in out
    assert "  force, boundary" in out
    assert "algebraic" not in out
    assert "  u                           of another program; " in out
    _, solved, _ = run("solve", "p.yaml", "--h", "1/8", "--H", "1/4")  # control
    assert "another program" not in solved
    for extra, bounds in (([], files.bounds), (["--sharp"], files.sharp_bounds)):
        assert run_certify(run, "--solution", "u.vtu", *extra) == (0, pytest.approx(bounds.u, rel=1e-12), "")


def test_columns_of_a_csv_are_matched_by_places_or_by_order(files, run):
    order = np.random.default_rng(2).permutation(len(files.u))
    table("places.csv", "x,y,u", *files.mesh.points[order].T, files.u[order])
    table("named.csv", "x,y,u,v", *files.mesh.points.T, 0 * files.u, files.u)
    table("order.csv", "u", files.u)
    table("wrong.csv", "u", files.u[order])
    expected = 0, pytest.approx(files.bounds.u, rel=1e-9), ""
    for arguments in (["places.csv"], ["named.csv", "--field", "v"], ["order.csv"]):
        assert run_certify(run, "--mesh", "mesh.vtu", "--solution", *arguments) == expected
    code, bound, _ = run_certify(run, "--mesh", "mesh.vtu", "--solution", "wrong.csv")
    assert code == 0
    assert bound > 10 * files.bounds.u


def test_values_in_the_file_of_the_mesh_have_its_order_also_where_nodes_are_moved_onto_sides(files, run):
    """Five decimals explain that all nodes are away by 1e-5; matched by places, the corners would be lost."""
    write("off.vtu", files.mesh.points + 1e-5, [("triangle", files.mesh.triangles)], {"u": files.u})
    code, bound, err = run_certify(run, "--solution", "off.vtu")
    assert (code, bound, err) == (0, pytest.approx(files.bounds.u, rel=1e-4), "")
    table("off.csv", "x,y,u", *(files.mesh.points.T + 1e-5), files.u)
    code, _, err = run_certify(run, "--solution", "off.csv", "--mesh", "mesh.vtu")  # control
    assert (code, err.split(";")[0]) == (2, "unilateral: off.csv: another mesh")


def test_of_second_order_triangles_the_corners_are_taken(files, run):
    mesh = files.mesh
    n = files.mesh.n_nodes
    middles = 0.5 * mesh.points[mesh.triangulation.ends].sum(axis=1)
    cells = np.column_stack([mesh.triangles, n + mesh.opposite_edges[:, [2, 0, 1]]])
    values = np.append(files.u, np.full(len(middles), 99.0))
    points = np.concatenate([mesh.points, middles])
    write("p2.vtu", points, [("triangle6", cells)], {"u": values})
    write("only.vtu", points, [("triangle6", cells)])
    table("corners.csv", "x,y,u", *mesh.points.T, files.u)
    assert run_certify(run, "--solution", "corners.csv", "--mesh", "only.vtu")[:2] == (
        0,
        pytest.approx(files.bounds.u, rel=1e-9),
    )
    code, bound, err = run_certify(run, "--solution", "p2.vtu")
    assert (code, bound) == (0, pytest.approx(files.bounds.u, rel=1e-12))
    assert err == (
        "unilateral: p2.vtu: its triangles are of second order; the linear function with the values at their "
        "corners is used\n"
    )


def test_penetration_is_told(files, run):
    table("u.csv", "u", files.u - 1)
    code, _, err = run_certify(run, "--mesh", "mesh.vtu", "--solution", "u.csv")
    assert code == 0
    assert err.startswith("unilateral: most of the bound on the error of u comes from places where u < g")


def test_files_are_written_and_the_certificate_is_proved(files, run):
    arguments = ["--solution", "u.vtu", "-o", "shares.vtu", "-o", "u.json", "--certificate", "c.json.gz"]
    code, out, err = run("certify", "p.yaml", *arguments)
    assert (code, err) == (0, "")
    assert all(
        f"  written                     {name}" in out for name in ("shares.vtu", "u.json", "c.json.gz")
    )
    assert "error_share" in meshio.read("shares.vtu").cell_data
    checked = subprocess.run(
        [sys.executable, ROOT / "certificate/check.py", "c.json.gz"],
        capture_output=True,
        text=True,
        timeout=60,
    )
    proved = float(checked.stdout.split("|||u - v||| <= ")[1].split(",")[0])
    assert proved == pytest.approx(files.bounds.u, rel=0.03)  # as issue 46 asks of both


REFUSED = {
    "no file": (["nix.vtu"], "argument --solution: there is no file 'nix.vtu'"),
    "no mesh": (["u.csv"], "--mesh is missing, because u.csv has no triangles"),
    "another mesh": (
        ["u.vtu", "--mesh", "coarse.vtu"],
        "u.vtu: another mesh; 56 of its 81 points are no nodes",
    ),
    "another field": (["u.vtu", "--field", "w"], "u.vtu: there is no w at the nodes; --field names"),
    "no field": (["mesh.vtu"], "mesh.vtu: there is no u at the nodes; --field"),
    "numbers of nodes": (["ids.vtu"], "ids.vtu: there is no u at the nodes; --field"),
    "vectors": (["vectors.vtu"], "vectors.vtu: it cannot be read (cannot reshape"),
    "too short": (["short.csv", "--mesh", "mesh.vtu"], "u has the shape (80,); it has to be (81,)"),
    "places of other names": (
        ["points.csv", "--mesh", "mesh.vtu"],
        "points.csv: there are no columns x and y",
    ),
    "places without x": (["y.csv", "--mesh", "mesh.vtu"], "y.csv: there are no columns x and y"),
    "not finite": (["nan.csv", "--mesh", "mesh.vtu"], "u[0] is nan; it has to be finite"),
}


@pytest.mark.parametrize(("arguments", "message"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused(arguments, message, files, run):
    table("u.csv", "x,y,u", *files.mesh.points.T, files.u)
    table("short.csv", "u", files.u[1:])
    table("points.csv", "u,Points:0,Points:1", files.u, *files.mesh.points.T)
    table("y.csv", "y,u", files.mesh.points[:, 1], files.u)
    table("nan.csv", "u", np.append(np.nan, files.u[1:]))
    coarse = ul.Solver("p.yaml", h=1 / 4, H=1 / 2).mesh
    write("coarse.vtu", coarse.points, [("triangle", coarse.triangles)])
    write(
        "ids.vtu", files.mesh.points, [("triangle", files.mesh.triangles)], {"ids": np.arange(len(files.u))}
    )
    vectors = {"u": np.zeros((len(files.u), 3))}
    write("vectors.vtu", files.mesh.points, [("triangle", files.mesh.triangles)], vectors)
    code, out, err = run("certify", "p.yaml", "--solution", *arguments)
    assert (code, out) == (2, "")
    assert err.startswith(f"unilateral: {message}")
    assert err.count("\n") == 1
