"""Cases with clamped sides as files: what these say, right solutions of them, and spoilt ones."""

import importlib.util
import json
import re
from contextlib import redirect_stdout
from functools import cache
from io import StringIO

import author
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import ROOT
from scipy.sparse.linalg import spsolve

import unilateral as ul
from unilateral.cli import main
from unilateral.exchange.boundary_function import piecewise_constant
from unilateral.exchange.case_formulas import DEFINITIONS, render_case_module
from unilateral.exchange.exported_folder import read_exported_folder, read_foreign_solution
from unilateral.exchange.score import score_solution
from unilateral.fem.p1 import stiffness_and_mass

pytestmark = pytest.mark.usefixtures("levels_solved_once")
CASES = {"clamped": (2, 0), "clamped_270": (1, 0), "clamped_90": (3, 1)}
"""The side that is clamped, and c."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A case on two levels, h = 1/8 and 1/16, H = 2h."""

    @cache
    def export_case(name):
        out = tmp_path_factory.mktemp("clamped") / name
        with redirect_stdout(StringIO()):  # a test that reads JSON may be the first to ask for the case
            assert (
                main(["export", name, "--h", "1/16", "--H", "1/8", "--levels", "2", "--out", str(out)]) == 0
            )
        return out

    return export_case


@pytest.fixture(scope="module")
def own_solution(folder):
    """The case, the finest level and this project's solution there."""

    @cache
    def solve_exported_case(name):
        case, levels = read_exported_folder(folder(name))
        return case, levels, ul.solve(case, H=levels[-1].partition.H, mesh=levels[-1].mesh)

    return solve_exported_case


@pytest.fixture
def score_spoilt(own_solution, tmp_path):
    """The score of u and columns beside it at the nodes, and of values on the cells."""

    def scoring(name, u, cells=None, **nodal):
        case, levels, _ = own_solution(name)
        x, y = levels[-1].mesh.points.T
        pd.DataFrame({"x": x, "y": y, "u": u, **nodal}).to_csv(tmp_path / "u.csv", index=False)
        if cells is None:
            return score_solution(case, read_foreign_solution(levels, str(tmp_path / "u.csv")))
        s = levels[-1].partition.points
        table = pd.DataFrame({"start": s[:-1], "end": s[1:], "multiplier": cells})
        table.to_csv(tmp_path / "cells.csv", index=False)
        return score_solution(
            case, read_foreign_solution(levels, str(tmp_path / "u.csv"), str(tmp_path / "cells.csv"))
        )

    return scoring


def clamped_nodes(mesh, side):
    """The nodes of a side, its ends included."""
    indices = np.flatnonzero(mesh.side == side)
    return mesh.boundary[np.append(indices, indices[-1] + 1) % len(mesh.boundary)]


@pytest.mark.parametrize("name", CASES)
def test_the_files_tell_what_is_given_where(folder, name):
    """u_D by its formula at the clamped nodes alone; no g there, and none on cells and edges of the side."""
    (side, c) = CASES[name]
    problem = json.loads((folder(name) / "problem.json").read_text())
    assert [problem[key] for key in ("clamped_sides", "free_sides", "k", "c")] == [[side], [], 1, c]
    assert [i for i, formula in enumerate(problem["u_D"]) if formula is not None] == [side]
    case, (*_, level) = read_exported_folder(folder(name))
    nodes = pd.read_csv(folder(name) / "level_1/nodes.csv")
    cells = pd.read_csv(folder(name) / "level_1/partition.csv")
    subset = clamped_nodes(level.mesh, side)
    assert (np.flatnonzero(nodes.u_D.notna()) == np.sort(subset)).all()
    names = {"x": nodes.x[subset], "y": nodes.y[subset]}
    exec(DEFINITIONS, names)
    np.testing.assert_allclose(nodes.u_D[subset], eval(problem["u_D"][side], names), rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        nodes.u_D[subset], case.exact.value_and_gradient(level.mesh.points[subset])[0], rtol=0, atol=1e-15
    )
    contact_nodes = np.setdiff1d(level.mesh.boundary, subset)
    assert (np.flatnonzero(nodes.g.notna()) == contact_nodes).all()
    assert (cells.g_mean.isna() == (cells.side == side)).all()
    rule = xr.load_dataset(folder(name) / "level_1/quadrature.nc")
    assert (np.isnan(rule.g) == (rule.side == side)).all()


@pytest.mark.parametrize("name", CASES)
def test_the_readme_and_the_modules_tell_the_problem(folder, name):
    """The equation, what is given, and the norm of errors; without clamped sides none of it is there."""
    (side, c) = CASES[name]
    text = (folder(name) / "README.md").read_text()
    assert f"Clamped sides: {side}. There u = u_D is given, and there is no obstacle and no λ." in text
    assert ("−Δu + u = f in Ω" in text, "−Δu = f in Ω" in text) == (c == 1, c == 0)
    assert ("u in |v|_1 = (∫ |∇v|²)^(1/2)." if c == 0 else "u in ||v||_1 = (∫ |∇v|² + v²)^(1/2).") in text
    assert "{" not in text
    for kind in ("python", "ufl"):
        head = render_case_module(read_exported_folder(folder(name))[0].exact, kind).split('"""')[1]
        equation = "-lap u + u = f" if c else "-lap u = f"
        assert f"{equation}; on the boundary" in head
        assert f"but u = g on the sides {side}.\n" in head
    assert "clamped" not in render_case_module(ul.case("natural").exact, "python")


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("ending", [".nc", ".vtu"])
def test_this_projects_own_solution_scores_its_own_errors(own_solution, run, folder, tmp_path, name, ending):
    """By `Solution.errors`, which never saw a file."""
    _, _, solution = own_solution(name)
    solution.save(tmp_path / f"own{ending}")
    code, out, _ = run("score", folder(name), tmp_path / f"own{ending}", "--json")
    (record,) = json.loads(out)["solutions"]
    assert (code, record["faults"]) == (0, [])
    # On edges the same function takes other quadrature points; `dual` rounds 1e-9 of the norm of lambda.
    tolerance = 1e-12 if ending == ".nc" else 1e-6
    assert record["errors"] == pytest.approx(solution.errors._asdict(), rel=tolerance)
    assert record["own_errors"] == pytest.approx(solution.errors._asdict(), rel=1e-12)


@pytest.mark.parametrize("name", CASES)
def test_the_norm_of_u_is_named(own_solution, run, folder, tmp_path, name):
    """As text and on the page."""
    own_solution(name)[2].save(tmp_path / "own.nc")
    code, out, _ = run("score", folder(name), tmp_path / "own.nc", "--html", tmp_path / "own.html")
    assert (code, f"{name}: no fault was found; " in out) == (0, True)
    assert ("u in |·|₁" if CASES[name][1] == 0 else "u in H¹") in (tmp_path / "own.html").read_text()
    assert ("u in |.|_1" in out, "u in H1" in out) == (CASES[name][1] == 0, CASES[name][1] == 1)


def driver():
    spec = importlib.util.spec_from_file_location("driver", ROOT / "examples/score_scikit_fem.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", CASES)
def test_scikit_fem_solves_what_is_exported(folder, tmp_path, run, name):
    """Another code with constraints at nodes: no fault, and u is as near as the nearest function nearly is.

    A problem with another right-hand side, or without u_D, would be told.
    """
    _, levels = read_exported_folder(folder(name))
    for level in levels:
        table = driver().solved(folder(name) / level.name, CASES[name][1])
        table.to_csv(tmp_path / f"{level.name}.csv", index=False)
    code, out, _ = run("score", folder(name), *(tmp_path / f"{level.name}.csv" for level in levels), "--json")
    assert code == 0
    for solution in json.loads(out)["solutions"]:
        assert (solution["faults"], solution["remarks"]) == ([], [])
        assert solution["errors"]["h1"] <= 1.05 * solution["own_errors"]["h1"]
        assert solution["errors"]["hm12_upper"] > 0


@pytest.mark.parametrize("name", CASES)
def test_own_files_are_scored_though_they_have_no_multiplier_on_clamped_sides(
    own_solution, folder, tmp_path, run, name
):
    """It is missing there, in CSV, netCDF and VTU; the reaction is not 0."""
    _, levels, solution = own_solution(name)
    assert np.isnan(solution.multiplier).any()
    solution.save(tmp_path / "s.nc")
    solution.save(tmp_path / "s.vtu")
    solution.save(tmp_path / "cells.csv")
    x, y = levels[-1].mesh.points.T
    pd.DataFrame({"x": x, "y": y, "u": solution.u}).to_csv(tmp_path / "u.csv", index=False)
    for arguments in (["s.nc"], ["s.vtu"], ["u.csv", "--multiplier", "cells.csv"]):
        files = [argument if argument.startswith("--") else tmp_path / argument for argument in arguments]
        _, out, _ = run("score", folder(name), *files, "--json")
        (record,) = json.loads(out)["solutions"]
        assert (record["faults"], record["errors"]["l2"] > 0) == ([], True), arguments


@pytest.mark.parametrize("name", CASES)
def test_nothing_is_asked_of_a_multiplier_on_clamped_sides(own_solution, score_spoilt, name):
    """Whatever stands there, on cells or as reactions at nodes, changes no error and is no fault."""
    _, levels, solution = own_solution(name)
    mesh = levels[-1].mesh
    cells = levels[-1].partition
    mu = solution.multiplier
    right = score_spoilt(name, solution.u, mu)
    scores = score_spoilt(name, solution.u, np.where(cells.side == CASES[name][0], 7.0, mu))
    assert (scores.errors, scores.faults) == (right.errors, [])
    reactions = np.zeros(mesh.n_nodes)
    reactions[mesh.boundary] = piecewise_constant(cells, np.nan_to_num(mu)).load(mesh)
    plain = score_spoilt(name, solution.u, reaction=reactions)
    reactions[clamped_nodes(mesh, CASES[name][0])] = 7.0
    other_scores = score_spoilt(name, solution.u, reaction=reactions)
    assert other_scores.errors == plain.errors
    subset = cells.side != CASES[name][0]
    spoilt = score_spoilt(name, solution.u, np.where(subset, mu + 7.0, mu))
    assert spoilt.errors.l2 > 2 * right.errors.l2
    assert spoilt.faults != []


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("size", [1.0, 0.01])
def test_a_spoilt_value_at_a_clamped_node_is_named_with_its_place(own_solution, score_spoilt, name, size):
    """It alone: the equation holds where u_D takes its place. With a thousandth of 1 % u passes."""
    _, levels, solution = own_solution(name)
    mesh = levels[-1].mesh
    node = clamped_nodes(mesh, CASES[name][0])[2]
    u = solution.u.copy()
    (x, y) = mesh.points[node]
    u[node] += size * np.abs(u).max()
    for cells in (None, solution.multiplier):
        (fault,) = score_spoilt(name, u, cells).faults
        assert fault.startswith(f"u is not u_D on the clamped side {CASES[name][0]}: u - u_D is ")
        assert fault.endswith(f" at ({x:g}, {y:g})")
        measured = float(re.search(r"u - u_D is (\S+) at", fault)[1])
        assert measured == pytest.approx(size * np.abs(solution.u).max(), rel=0.05)
    u[node] = solution.u[node] + 1e-5 * np.abs(u).max()
    assert score_spoilt(name, u, solution.multiplier).faults == []


def test_values_of_another_solution_are_named_once(own_solution, score_spoilt):
    """u_D + 1 on the side, with the u that belongs to it by sparse elimination: inside nothing is wrong."""
    _, levels, solution = own_solution("clamped")
    mesh = levels[-1].mesh
    K = stiffness_and_mass(mesh)[0]
    subset = clamped_nodes(mesh, 2)
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    extra = np.zeros(mesh.n_nodes)
    extra[subset] = 1.0
    extra[inside] = spsolve(K[inside][:, inside].tocsc(), -(K @ extra)[inside])
    (fault,) = score_spoilt("clamped", solution.u + extra).faults
    assert fault.startswith("u is not u_D on the clamped side 2: u - u_D is 1 at ")


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("method", author.METHODS)
@pytest.mark.filterwarnings("ignore:Matrix is exactly singular")
def test_a_clamped_side_that_is_left_free_is_named(own_solution, folder, tmp_path, run, name, method):
    """Also for `clamped_270`, where no such solution exists: f pushes u up, and c is 0, so that u is huge."""
    u, _ = author.solve_level(author.read(folder(name), "level_1"), "clamped side left free", method)
    u.to_csv(tmp_path / "u.csv", index=False)
    code, out, _ = run("score", folder(name), tmp_path / "u.csv", "--json")
    (record,) = json.loads(out)["solutions"]
    text = f"u is left free on the clamped side {CASES[name][0]}: u - u_D is "
    assert (code, sum(fault.startswith(text) for fault in record["faults"])) == (1, 1)
    assert len(record["faults"]) == (2 if name == "clamped_270" else 1)


@pytest.mark.parametrize("name", CASES)
def test_a_spoilt_multiplier_is_named(own_solution, score_spoilt, name):
    _, _, solution = own_solution(name)
    u = solution.u
    mu = solution.multiplier
    for wrong, message in (
        (-mu, "the multiplier has the wrong sign: -1 times"),
        (2 * mu, "the wrong scale: 2 "),
    ):
        (fault,) = score_spoilt(name, u, wrong).faults
        assert message in fault
    wave = np.where(np.arange(len(mu)) % 2, 1.1, 0.9)
    (fault,) = score_spoilt(name, u, wave * mu).faults
    form, norm = ("(u, v)_1", "H1") if CASES[name][1] else ("(grad u, grad v)", "|.|_1")
    assert f"{form} - <lambda, v> - (f, v) is " in fault
    assert fault.endswith(f" in {norm}")
