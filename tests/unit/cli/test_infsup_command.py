"""`unilateral infsup`: the library's constants, and the local rule's verdict."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from conftest import couple_structured_mesh

from unilateral.formulas.decimals import format_down, format_interval
from unilateral.geometry import mesh as meshes
from unilateral.geometry.files import write_mesh
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.fortin import beta_lower_bound
from unilateral.norms.infsup import infsup_constants

SQUARE = ("--polygon", "square")


@pytest.fixture
def run_infsup(run):
    """What is printed as JSON, and nothing else."""

    def finding(*arguments):
        code, out, err = run("infsup", *arguments, "--json")
        assert (code, err, out.count("\n")) == (0, "", 1)
        return json.loads(out)

    return finding


def test_the_constants_are_the_library_s(run, run_infsup):
    """At H = 2h on the square; the rule is kept, and beta is above the 1/2 of claim S.local."""
    printed = run_infsup(*SQUARE, "--h", "1/16", "--H", "1/8")
    expected = infsup_constants(
        couple_structured_mesh("square", 16, 8).operator,
        build_dual_norm(make_uniform_partition(square(), 1 / 8)).gram().p0,
    )
    for name, value in expected._asdict().items():
        assert printed[name] == pytest.approx(value, rel=1e-9), name
    assert printed["beta_lower"] >= 0.5
    assert (printed["edges_per_cell"], printed["cell_over_edge"]) == (2, 2)
    assert printed["smallest_angle"] == pytest.approx(45)
    assert printed["rule"] == {
        "cell_over_edge": 2,
        "smallest_angle": 20,
        "kept": True,
        "cells": [],
        "triangles": [],
    }
    _, out, _ = run("infsup", *SQUARE, "--h", "1/16", "--H", "1/8")
    bounds = format_interval(expected.beta_lower, expected.beta_upper, spec=".4f")
    assert f"  beta in H^(-1/2)  {bounds}, up to rounding\n" in out
    assert "  local rule        kept\n" in out
    proved = format_down(
        beta_lower_bound(
            couple_structured_mesh("square", 16, 8).mesh, make_uniform_partition(square(), 1 / 8)
        ),
        ".4f",
    )
    assert f"  Theorem 5         proves beta >= {proved} here, guaranteed: delta = 0.5, alpha_1 = 1\n" in out
    assert (printed["not_solved"], printed["beta_fortin"] >= float(proved)) == ("", True)
    assert (printed["theorem_5"], printed["delta"], printed["alpha_1"]) == (True, 0.5, 1)


def test_a_mesh_and_cells_from_files_have_the_constants_of_the_same_pair(run_infsup, tmp_path):
    """The same pair from files, by so many cells a side, and by their arc lengths in any order."""
    write_mesh(make_structured_mesh(square(), 1 / 8), tmp_path / "own.msh")
    ends = np.arange(17) / 4
    rows = [f"{start},{end}" for start, end in pairwise(ends)]
    (tmp_path / "cells.csv").write_text("\n".join(["start,end", *reversed(rows)]))
    expected = run_infsup(*SQUARE, "--h", "1/8", "--H", "1/4")
    for cells in ("4", str(tmp_path / "cells.csv")):
        printed = run_infsup("--mesh", str(tmp_path / "own.msh"), "--cells", cells)
        for name in ("beta_lower", "beta_upper", "beta_0", "unknowns", "multipliers", "cell_over_edge"):
            assert printed[name] == pytest.approx(expected[name], rel=1e-9), name
        assert printed["vertices"] == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_the_cells_that_break_the_rule_are_named(run, run_infsup, tmp_path):
    """By hand: side 0 has 2 edges for 4 cells, half an edge in each; the other sides have 8."""
    s = np.concatenate([[0, 0.5], 1 + np.arange(24) / 8])
    write_mesh(meshes.triangulate_from_boundary(square(), s), tmp_path / "own.msh")
    pair = ["--mesh", str(tmp_path / "own.msh"), "--cells", "4"]
    cells = run_infsup(*pair)["rule"]["cells"]
    assert [cell["cell"] for cell in cells] == [0, 1, 2, 3]
    assert [cell["start"] for cell in cells] == [0, 0.25, 0.5, 0.75]
    assert all((cell["side"], cell["edges"], cell["cell_over_edge"]) == (0, 0.5, 0.5) for cell in cells)
    assert [cell["delta"] for cell in cells] == [0, 0, 0, 0]
    out = run("infsup", *pair)[1]
    assert "BROKEN by 4 cells and" in out
    assert (
        "    cell 1 on side 0, s = 0.25 to 0.5: edges = 0.5, cell over longest edge = 0.5, delta = 0\n" in out
    )
    assert "  Theorem 5         does NOT apply: delta = 0, alpha_1 = 1\n" in out


def test_a_node_inside_a_long_edge_s_cell_is_enough_for_the_theorem(run, run_infsup, tmp_path):
    """Three nodes for four cells, by hand: 0.1 in the first, 0.3, 0.6 and 0.9; the other sides have 8 edges.

    delta = 0.1/0.25, from the node 0.1 and from 0.9, or 0.05/0.25, from 0.3; the edges break the rule.
    """
    s = np.concatenate([[0, 0.1, 0.3, 0.6, 0.9], 1 + np.arange(24) / 8])
    write_mesh(meshes.triangulate_from_boundary(square(), s), tmp_path / "own.msh")
    printed = run_infsup("--mesh", str(tmp_path / "own.msh"), "--cells", "4")
    assert (printed["theorem_5"], printed["rule"]["kept"]) == (True, False)
    assert printed["delta"] == pytest.approx(0.2, rel=1e-9)
    expected = [0.4, 0.2, 0.4, 0.4]
    assert [cell["delta"] for cell in printed["rule"]["cells"]] == pytest.approx(expected, rel=1e-9)


def test_the_triangles_that_break_the_rule_are_named(run, run_infsup, tmp_path):
    """One triangle of the height 1/10 over its side 1, by hand; each side is an edge and a cell."""
    thin = Polygon(np.array([[0, 0], [1, 0], [1, 0.1]]), "thin")
    write_mesh(meshes.from_arrays(thin, thin.vertices, [[0, 1, 2]]), tmp_path / "thin.vtu")
    report = run_infsup("--mesh", str(tmp_path / "thin.vtu"), "--cells", "1")
    (flat,) = report["rule"]["triangles"]
    assert flat["angle"] == report["smallest_angle"] == pytest.approx(math.degrees(math.atan(0.1)))
    assert (flat["triangle"], flat["x"], flat["y"]) == (0, pytest.approx(2 / 3), pytest.approx(1 / 30))
    assert len(report["rule"]["cells"]) == 3
    out = run("infsup", "--mesh", str(tmp_path / "thin.vtu"), "--cells", "1")[1]
    assert "BROKEN by 3 cells and 1 triangle" in out
    assert "    triangle 0 at (0.666667, 0.0333333): 5.711 degrees\n" in out


def test_where_beta_is_0_it_is_said_and_long_lists_are_cut(run):
    """More cells than boundary nodes: 32 and 16, by the dimension of V_h on the boundary."""
    code, out, _ = run("infsup", *SQUARE, "--h", "1/4", "--H", "1/8")
    assert code == 0
    assert "  beta in H^(-1/2)  0 up to rounding: lambda_H may not be unique" in out
    assert out.count("    cell ") == 10
    assert "    and 22 more; --json lists all\n" in out


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("start,stop\n0,1", "the columns start and end are needed, a row per cell"),
        ("start,end\n0,x", "the columns start and end are needed, a row per cell"),
        ("", "the columns start and end are needed, a row per cell"),
        ("start,end\n0,1\n1.5,4", "a cell ends at s = 1, the next begins at 1.5; cells have to follow"),
        ("start,end\n0,1\nnan,4", "a cell ends at s = 1, the next begins at nan"),
        ("start,end\n0,1\n1,2\n2,4", "vertex 3 of polygon 'square', at arc length 3, is missing"),
        ("start,end\n0,1\n1,2\n2,3\n3,5", "point 4 (5) is out of order"),
    ],
)
def test_a_file_of_cells_that_is_none_is_refused(refusal, tmp_path, rows, message):
    file = tmp_path / "cells.csv"
    file.write_text(rows)
    message_value = refusal("infsup", *SQUARE, "--h", "1/4", "--cells", file)
    assert f"{file}: " in message_value
    assert message in message_value


@pytest.mark.parametrize("c", [0, 1])
def test_a_problem_file_says_which_sides_are_clamped(run, tmp_path, c):
    """These have no multipliers, and functions vanish there; the computed bound is below beta."""
    file = tmp_path / "own.yaml"
    fields = "polygon: [[0, 0], [1, 0], [1, 1], [0, 1]], f: 1, g: [null, -1, -1, null], u: {0: 0, 3: x - x}"
    file.write_text(f"{{{fields}, c: {c}}}")
    sizes = ["--polygon", str(file), "--h", "1/8", "--H", "1/4"]
    code, out, _ = run("infsup", *sizes, "--json")
    document = json.loads(out)
    assert (code, document["multipliers"], document["clamped_sides"]) == (0, 8, [0, 3])
    assert 0.4 < document["beta_fortin"] < document["beta_lower"] <= document["beta_upper"] < 0.8
    assert "sides 0, 3, without multipliers" in run("infsup", *sizes)[1]
    file.write_text(f"{{polygon: [[0, 0], [1, 0], [0, 1]], f: 1, g: 0, u: {{0: 0, 1: 0, 2: 0}}, c: {c}}}")
    code, _, err = run("infsup", *sizes)
    assert code == 2
    assert "all sides of 'own.yaml' are clamped, so that there are no multipliers" in err


def test_however_it_is_written_c_is_0(run, tmp_path):
    """Control: c = 1 has other constants."""
    file = tmp_path / "own.yaml"
    beta_0 = {}
    for c in ("0", "0.0", "1 - 1", "1"):
        file.write_text(
            "{polygon: [[0, 0], [1, 0], [1, 1], [0, 1]], f: 1, g: [null, -1, -1, -1], u: {0: 0}, "
            f'c: "{c}"}}'
        )
        out = run("infsup", "--polygon", str(file), "--h", "1/4", "--H", "1/2", "--json")[1]
        beta_0[c] = json.loads(out)["beta_0"]
    assert beta_0["0"] == beta_0["0.0"] == beta_0["1 - 1"] != beta_0["1"]
