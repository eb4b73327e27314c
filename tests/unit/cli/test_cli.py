"""The command line: what it prints, where, and with which exit code."""

import itertools
import json
import os
import re
import signal
import subprocess
import sys
import tomllib
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA, ROOT, certified, discrete, load
from documents import blocks

from unilateral.accuracy.watch import Watch
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.source import enclosed
from unilateral.cli import main
from unilateral.cli.application import COMMANDS
from unilateral.cli.watching import bar
from unilateral.discrete import base, condensed
from unilateral.formulas.decimals import between, up
from unilateral.norms.dual import dual_norm
from unilateral.problems import case
from unilateral.solution import Solution
from unilateral.study.ledger import claims

KEYS = [  # of --json, in the documented order
    *(
        "problem",
        "goal",
        "norm",
        "certified",
        "ended",
        "reach",
        "k",
        "c",
        "norms",
        "h",
        "diameter",
        "H",
        "adapted",
    ),
    *("triangles", "unknowns", "multipliers", "algorithm", "iterations", "converged", "algebraic_bound"),
    *("unique", "h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error", "bounds", "h1_bound"),
    *("hm12_bound", "h1_relative_bound", "hm12_relative_bound", "enclosure", "total_bound", "levels"),
    *("contact", "versions", "forces", "seconds", "peak_mb"),
]
KEYS_OF_PLAN = [*("problem", "adapted", "unknowns", "seconds", "peak_mb", "missed", "ended", "reach")]
NOT_UNIQUE = (
    "unilateral: lambda_H may not be unique, because beta is 0 to rounding; take h < H, such as H = 2h\n"
)
SIZES = ("--h", "1/8", "--H", "1/4")
FINER = ("--h", "1/16", "--H", "1/8")
PROBLEM = str(DATA / "problems/triangle.yaml")
SCRIPT = Path(sys.executable).with_name("unilateral")

pytestmark = pytest.mark.usefixtures("shared_cases")


@pytest.fixture
def run(capsys):
    """The command's exit code, and what it prints on standard output and error."""

    def running(*arguments):
        code = main(list(arguments))
        return code, *capsys.readouterr()

    return running


@pytest.fixture
def solve_json(run):
    """The exit code of `solve`, what it prints as JSON, in the documented order, and what it tells."""

    def solving(*arguments):
        code, out, err = run("solve", *arguments, "--json")
        assert out.count("\n") == 1
        found = json.loads(out)
        assert list(found) == KEYS
        return code, found, err

    return solving


def in_a_process(source):
    command = [sys.executable, "-c", source]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


def test_cases_lists_the_catalogue_with_its_certificates(run, monkeypatch):
    monkeypatch.setattr("unilateral.cli.cases.certify", lambda of: certified(of.name, of.polygon.name))
    code, out, err = run("cases")
    assert (code, err) == (0, "")
    for name in case.names():
        declaration = case.declared(name)[0]
        rows = [line.split() for line in out.splitlines() if line.startswith(f"{name} ")]
        on = ["square", "lshape", "hexagon"] if declaration["polygons"] == "any" else declaration["polygons"]
        assert [row[-1] for row in rows] == on
        hypotheses = ["yes" if value else "no" for value in declaration["hypotheses"].values()]
        assert all(row[1:4] == hypotheses for row in rows)
        assert declaration["title"] in out
    assert re.search(r"natural .* 0: 0\.5-1; sides 1, 2, 3 +square", out)


def test_solve_prints_a_table(run):
    code, out, err = run("solve", "natural", *FINER)
    assert (code, err) == (0, "")
    assert out.startswith("natural: h = 0.0625, H = 0.125, h/H = 0.5\n")
    solution = condensed.solve(discrete("natural", 16, 8))
    assert f"uzawa converged             algebraic error <= {up(solution.result.bound, '.4e')}" in out
    assert f"after {solution.result.iterations} steps" in out
    for name, sign, value in (("u - u_h||_1", "=", "h1"), ("lambda - lambda_H||_0", "=", "l2")):
        assert re.search(rf"\|\|{re.escape(name)} +{sign} {getattr(solution.errors, value):.4e}\n", out), name
    lower, upper = map(float, re.search(r"lambda_H\|\|_-1/2 +>= (\S+), <= (\S+)\n", out).groups())
    assert solution.errors.hm12_discrete <= lower * (1 + 1e-4)
    assert lower < upper <= 1.05 * lower


def test_json_has_the_library_s_numbers(solve_json):
    """natural at h = 1/16: the total bound is at least the error, and at most 30 % more."""
    code, found, err = solve_json("natural", *FINER)
    assert (code, err) == (0, "")
    alone, of = discrete("natural", 16, 8), load("natural")
    solution = condensed.solve(alone)
    lower, upper = dual_norm(alone.spaces.partition, [of]).of_error(of, solution.lambda_H[None])
    given = alone.spaces.partition, solution.u_h, solution.lambda_H
    mesh = alone.exact.ritz.condensed.mesh
    bound = local_bound(enclosed(mesh, of), of.enclosed_obstacle, *given)
    expected = {
        "problem": "natural",
        "h": 1 / 16,
        "diameter": np.sqrt(2) / 16,
        "H": 1 / 8,
        "unknowns": 17**2,
        "multipliers": 32,
        "iterations": solution.result.iterations,
        "converged": True,
        "algebraic_bound": solution.result.bound,
        "norm": "h1",
        "total_bound": bound.u,
        "h1_error": solution.errors.h1,
        "l2_error": solution.errors.l2,
        "hm12_error_lower": lower[0],
        "hm12_error_upper": upper[0],
    }
    for key, value in expected.items():
        assert found[key] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), key
    assert found["h1_error"] <= found["total_bound"] <= 1.3 * found["h1_error"]
    assert {name.split("_")[0] for name in KEYS if re.search("_error|_bound", name)} >= set(found["norms"])
    assert found["seconds"] > 0
    assert found["peak_mb"] > 1


def test_a_multiplier_outside_L2_has_a_lower_bound_and_no_other_number(run):
    """And beta is not what is to blame."""
    code, out, err = run("solve", "rough", *SIZES)
    assert (code, err) == (0, "")
    dual, l2 = (line for line in out.splitlines() if "  ||lambda - lambda_H" in line)
    assert ">= " in dual
    assert "<=" not in dual
    assert l2.endswith("= none, for lambda is not in L2")
    assert "beta" not in out


def test_where_beta_is_0_the_multiplier_is_not_judged(run, solve_json):
    """At H = h; the active set, which ran, counts no steps."""
    code, found, err = solve_json("natural", "--h", "1/8", "--H", "1/8")
    assert (code, err) == (0, NOT_UNIQUE)
    unknown = [key for key in KEYS if found[key] is None]
    assert unknown == [
        "goal",
        "ended",
        "reach",
        "iterations",
        "hm12_error_lower",
        "hm12_error_upper",
        "l2_error",
    ]
    assert found["h1_error"] == pytest.approx(condensed.solve(discrete("natural", 8, 8)).errors.h1, rel=1e-9)
    _, out, _ = run("solve", "natural", "--h", "1/8", "--H", "1/8")
    assert out.count("not judged, for beta is 0 to rounding") == 2
    assert "active_set converged" in out
    assert "steps" not in out


@pytest.mark.parametrize("problem", ["natural", PROBLEM])
def test_a_multiplier_that_may_not_be_unique_is_said(run, problem):
    """With more cells than boundary nodes beta = 0, whatever the mesh; control: it is positive at H = 2h."""
    code, out, err = run("solve", problem, "--h", "1/4", "--H", "1/8")
    assert (code, err) == (0, NOT_UNIQUE)
    assert f"\n  lambda_H                    {NOT_UNIQUE.split('lambda_H ')[1]}" in out
    code, out, err = run("solve", problem, *SIZES)
    assert (code, err) == (0, "")
    assert "unique" not in out


@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov", "active_set"])
def test_all_algorithms_agree(solve_json, algorithm):
    """Each within its own guaranteed bound of the same solution, in the norm of u's error."""
    code, found, _ = solve_json("thirds", *FINER, "--algorithm", algorithm)
    assert code == 0
    exact = condensed.solve(discrete("thirds", 16, 8))
    assert abs(found["h1_error"] - exact.errors.h1) <= found["algebraic_bound"] + exact.result.bound
    assert (found["iterations"] is None) == (algorithm == "active_set")


def test_the_lshape_and_a_side(solve_json):
    found = [solve_json("thirds", *SIZES, "--polygon", "lshape", "--side", side)[1] for side in "02"]
    assert [each["unknowns"] for each in found] == [3 * 64 + 4 * 8 + 1] * 2
    assert [each["multipliers"] for each in found] == [32] * 2
    assert found[0]["h1_error"] != found[1]["h1_error"]


def test_an_unstructured_mesh(solve_json):
    code, found, _ = solve_json("natural", *SIZES, "--mesh", "unstructured")
    assert code == 0
    assert found["h"] == pytest.approx(1 / 8, rel=1e-12)
    assert found["unknowns"] != 81


OWN_CASE = """\
title: contact everywhere
polygons: any
u: [{ atom: smooth, formula: (x - 1/2)**2 + (y - 1/2)**2 }]
gap: { elsewhere: 0 }
hypotheses: { j: true, jj: true, jjj: true }
asymptotic: { reason: none, h1: { from: 1 }, hm12: { from: 1 }, l2: { from: 1 } }
"""


def test_a_case_of_one_s_own(solve_json, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text(OWN_CASE)
    code, found, err = solve_json(str(file), *SIZES)
    assert (code, err, found["problem"]) == (0, "", "own")


@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov"])
def test_too_few_steps_end_with_code_3_and_a_message(run, solve_json, algorithm):
    options = ("natural", *SIZES, "--max-steps", "1", "--algorithm", algorithm)
    code, found, err = solve_json(*options)
    assert (code, found["converged"], found["iterations"]) == (3, False, 1)
    bound = up(found["algebraic_bound"], ".4e")
    assert err == f"unilateral: the iteration did not converge: the algebraic error is at most {bound}\n"
    code, out, _ = run("solve", *options)
    assert code == 3
    assert f"{algorithm} NOT converged" in out


def test_rho_and_tolerance_are_obeyed(solve_json):
    options = (("1e-2", "--rho", "1/4"), ("1e-8", "--rho", "1/4"), ("1e-8",))
    loose, tight, default = (solve_json("natural", *SIZES, "--tolerance", *each)[1] for each in options)
    assert tight["algebraic_bound"] <= 1e-8 < loose["algebraic_bound"] <= 1e-2
    assert loose["iterations"] < tight["iterations"]
    assert default["iterations"] < tight["iterations"]


def test_an_accuracy_of_a_case(run, solve_json):
    code, found, err = solve_json("natural", "--accuracy", "1e-1")
    assert (code, err, found["certified"]) == (0, "", True)
    assert found["h1_error"] <= found["total_bound"] <= 0.5
    assert found["h"] == found["H"] / 2
    _, out, _ = run("solve", "natural", "--accuracy", "1e-1")
    lines = out.splitlines()
    assert lines[0] == "natural: ||u - u_h||_1 <= 0.1 ||u||_1"
    levels = [line.split() for line in lines[2:] if re.fullmatch(r"[ 0-9.e-]+", line)]
    assert [float(level[0]) for level in levels][:2] == [0.5, 0.25]
    assert [float(level[1]) for level in levels][:2] == [0.5, 0.25]
    assert int(levels[-1][3]) == found["unknowns"]
    assert sum(int(level[5]) for level in levels) == found["iterations"]
    bound = re.escape(up(found["total_bound"], ".4e"))
    assert re.search(rf"  certified: .* <= {bound} <= 0.0\d+ \|\|u\|\|_1, \|\|u\|\|_1 >= ", out)
    (line,) = re.findall(r"  the guarantee rests on +(.*)", out)
    assert re.fullmatch(r"f, g and q enclosed, which adds [0-9.e-]+; exact .*; nothing sampled", line)


def test_an_absolute_accuracy(run, solve_json):
    """u of `natural` has the norm 5: the bound is at most what is asked for, not 5 times that."""
    arguments = ("natural", "--accuracy", "1.5", "--absolute")
    code, found, err = solve_json(*arguments)
    assert (code, err, found["certified"]) == (0, "", True)
    assert found["h1_error"] <= found["total_bound"] <= 1.5
    assert run("solve", *arguments)[1].startswith("natural: ||u - u_h||_1 <= 1.5\n")


def test_a_table_shows_the_shortest_edge_of_adapted_meshes(run):
    """At a re-entrant corner, unless uniform meshes are asked for."""
    for options, adapted in (((), True), (("--mesh", "structured"), False)):
        code, out, _ = run("solve", str(DATA / "problems/lshape.yaml"), "--accuracy", "0.2", *options)
        levels = [line.split() for line in out.splitlines()[2:] if re.fullmatch(r"[ 0-9.e-]+", line)]
        assert code == 0
        assert (float(levels[-1][1]) < float(levels[-1][0]) / 2) == adapted
        assert all(float(level[1]) <= float(level[0]) for level in levels)


HIDDEN = "1 + 9/10*exp(-2500*((x - 409/500)**2 + (y - 397/500)**2))"
"""A peak between the points of the rules that were once used: 9 unknowns were certified to 1.6e-8."""


def test_a_peak_that_hides_from_rules_is_not_certified_too_early(solve_json, problem_file_of):
    """The best approximation of u on 9 nodes is 6.3e-4 away (an independent computation); lambda is 0."""
    file = problem_file_of(f=HIDDEN, g=0)
    code, found, _ = solve_json(file, "--accuracy", "1e-4", "--mesh", "structured")
    assert (code, found["certified"]) == (0, True)
    assert found["unknowns"] > 1000
    code, adapted, _ = solve_json(file, "--accuracy", "1e-4")
    assert (code, adapted["certified"]) == (0, True)
    assert 9 < adapted["unknowns"] < found["unknowns"]
    _, coarse, _ = solve_json(file, "--h", "1/2", "--H", "1")
    assert coarse["total_bound"] >= 6.3e-4
    of_lambda = (file, "--accuracy", "1e-4", "--norm", "hm12", "--max-unknowns", "300")
    assert solve_json(*of_lambda)[0] == 3


def test_what_cannot_be_enclosed_is_not_guaranteed(run, problem_file_of):
    """A wave too short for the pieces: code 3, and what samples would certify is called an estimate."""
    file = problem_file_of(f="1 + cos(3200*pi*x)", g=0)
    code, out, _ = run("solve", file, "--accuracy", "1e-2")
    assert code == 3
    assert re.search(r"NOT guaranteed, for f or g varies too fast .*the rest, is an estimate", out)


@pytest.mark.parametrize(
    ("of_u", "of_lambda", "options", "said"),
    [
        ({9: 1e-3, 81: 1e-3}, {}, ("1e-4", "--max-unknowns", "300"), "  unknowns                    25 and"),
        # the third level's bound of u would be small enough, but those of lambda contradict each other
        ({}, {9: 1e-3, 81: 1e-3}, ("0.05",), "  unknowns                    25 and"),
        ({}, {9: 1e-3, 25: 1e-3, 81: 1e-3}, ("0.05",), "bounds contradict each other: no bound is left"),
    ],
)
def test_bounds_that_contradict_each_other_are_withdrawn(run, monkeypatch, of_u, of_lambda, options, said):
    """Factors of bounds, by unknowns. The second level is the answer where the first and third disagree."""
    own = base.local_bound

    def spoilt(*arguments):
        found, (u, of_l) = own(*arguments), (of.get(len(arguments[3]), 1.0) for of in (of_u, of_lambda))
        return replace(found, u=u * found.u, lambda_=of_l * found.lambda_)

    monkeypatch.setattr(base, "local_bound", spoilt)
    code, out, err = run("solve", "natural", "--accuracy", *options)
    assert code == 3
    assert re.fullmatch(
        r"unilateral: \d bounds withdrawn, for they contradict each other; please report it\n", err
    )
    assert "  certified: " not in out
    assert said in out
    assert ("the guarantee rests on" in out) == ("25 and" in said)


def test_an_accuracy_of_a_problem_in_the_dual_norm(solve_json):
    code, found, _ = solve_json(PROBLEM, "--accuracy", "0.2", "--norm", "hm12")
    assert (code, found["problem"], found["norm"]) == (0, "triangle", "hm12")
    assert found["total_bound"] == found["hm12_bound"]
    unknown = [key for key in KEYS if found[key] is None]
    assert unknown == ["ended", "reach", *(key for key in KEYS if "_error" in key)]


def test_given_sizes_of_a_problem(run, solve_json):
    code, found, err = solve_json(PROBLEM, *SIZES)
    assert (code, err) == (0, "")
    assert found["h"] <= 1 / 8 < found["h"] * 2
    assert found["algebraic_bound"] <= 0.01 * found["total_bound"]
    _, out, _ = run("solve", PROBLEM, *SIZES)
    assert f"guaranteed                  ||u - u_h||_1 <= {up(found['total_bound'], '.4e')}" in out
    assert "lambda_H||_0" not in out


KEPT = {"solution.vtu", "boundary.csv", "solution.nc", "certificate.json", "solution.svg"}


def test_a_solution_is_kept(solve_json, tmp_path):
    """All files of a folder, which is made, and others by their endings; the certificate is what is told."""
    folder, extra = tmp_path / "new/out", [tmp_path / name for name in ("a.csv", "b.png")]
    named = [part for file in extra for part in ("-o", str(file))]
    code, found, err = solve_json("natural", *SIZES, "--out", str(folder), *named)
    assert (code, err) == (0, "")
    assert {file.name for file in folder.iterdir()} == KEPT
    assert {file.name for file in tmp_path.iterdir()} == {"new", "a.csv", "b.png"}
    assert json.loads((folder / "certificate.json").read_text()) == found
    assert (folder / "boundary.csv").read_bytes() == extra[0].read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-o", "x.abc"), "x.abc: the ending must be .vtu, .csv, .nc, .json, .svg, .png or .pdf"),
        (("-o", "none/x.vtu"), "none/x.vtu cannot be written: there is no folder none"),
        (("-o", "folder.vtu"), "folder.vtu cannot be written: it is a folder"),
        (("--out", "file/new"), "argument --out: file/new cannot be made: Not a directory"),
        (("--dry-run", "--out", "new"), "a --dry-run has no solution that could be kept"),
    ],
)
def test_what_cannot_be_kept_is_told_before_the_solve(run, tmp_path, monkeypatch, options, message):
    """Nothing is solved, or it would fail."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("unilateral.cli.solve.api.solve", None)
    (tmp_path / "file").touch()
    (tmp_path / "folder.vtu").mkdir()
    sizes = ("--accuracy", "0.1") if "--dry-run" in options else SIZES
    code, out, err = run("solve", "natural", *sizes, *options)
    assert (code, out) == (2, "")
    assert err.startswith(f"unilateral: {message}")
    assert err.count("\n") == 1
    assert {file.name for file in tmp_path.iterdir()} == {"file", "folder.vtu"}


def test_the_contact_is_printed(run, monkeypatch):
    """natural: on half of side 0, up to a cell, and on all others; full_contact: everywhere."""
    rows = dict(re.findall(r"^  (contact\S*(?: side .)?) +(.*)$", run("solve", "natural", *FINER)[1], re.M))
    start, end = map(float, re.match(r"(\S+) to (\S+);", rows["contact, side 0"]).groups())
    assert (start, end) == (pytest.approx(0.5, abs=1 / 8), 1)
    assert rows["contact"] == f"length {4 - start:g}"
    assert all(rows[f"contact, side {side}"] == "0 to 1; length 1" for side in (1, 2, 3))
    out = run("solve", "full_contact", *SIZES)[1]
    assert "  contact                     the whole boundary, length 4\n" in out
    assert "contact, side" not in out
    assert "  contact                     none\n" in run("solve", "no_contact", *SIZES)[1]
    monkeypatch.setattr("unilateral.cli.report.SIDES", 3)
    assert "contact, side" not in run("solve", "natural", *SIZES)[1]


def test_the_forces_are_printed(run, solve_json, monkeypatch):
    """The integral of natural's lambda is 16, by quadrature of its polynomial; free sides have none."""
    _, found, _ = solve_json("natural", *FINER, "--sharp")
    assert list(found["forces"]) == ["boundary", "side_0", "side_1", "side_2", "side_3"]
    whole = found["forces"]["boundary"]
    assert 15.9 < whole["lower"] <= 16 <= whole["upper"] < 16.1
    _, out, _ = run("solve", "natural", *FINER, "--sharp")
    value, *bounds = found["forces"]["side_2"].values()
    numbers = f"{value:.4e}, between {between(*bounds, '.4e', 'and')}"
    assert f"  force, side 2               {numbers}\n" in out
    _, found, _ = solve_json("thirds", *FINER, "--free-sides", "1,3")
    assert list(found["forces"]) == ["boundary", "side_0", "side_2"]
    monkeypatch.setattr("unilateral.cli.solve.SIDES", 3)
    _, found, _ = solve_json("natural", *FINER)
    assert found["forces"] is None


@pytest.fixture
def looks(monkeypatch):
    """A clock that shows how often it was looked at: a look is a second. The handler's looks are left out."""
    count = itertools.count()
    monkeypatch.setattr("unilateral.cli.watching.TICK", 0)
    monkeypatch.setattr(Watch, "elapsed", property(lambda _: float(next(count))))


@pytest.mark.parametrize(("option", "value"), [("--max-unknowns", "100"), ("--max-seconds", "60")])
@pytest.mark.usefixtures("looks")
def test_a_budget_that_ends_is_code_3(run, solve_json, option, value):
    """And what would be enough is said: more than the unknowns so far."""
    arguments = ("natural", "--accuracy", "1e-3", option, value)
    code, out, err = run("solve", *arguments)
    assert (code, err) == (3, "")
    assert re.search(rf"NOT certified, out of budget \(.*{option} {value}.*\): \|\|u - u_h\|\|_1 <= ", out)
    (needed,) = re.findall(r"; about (\S+) unknowns, \S+ s and \S+ MB would be enough\n", out)
    code, found, _ = solve_json(*arguments[:3], "--max-unknowns", "100")
    assert float(needed) > 1e4 > found["unknowns"]
    assert (code, found["certified"]) == (3, False)
    assert (found["ended"], found["reach"]) == ("out of budget (max_unknowns=100)", None)
    assert found["total_bound"] >= found["h1_error"]


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def interrupt_in(phase, done, monkeypatch):
    """In that phase of the level after so many: a signal, as Ctrl-C sends it."""
    own, count = Watch._next, itertools.count()

    def interrupting(watch, name):
        own(watch, name)
        if name == phase and next(count) == done:
            interrupt()

    monkeypatch.setattr(Watch, "_next", interrupting)


def test_the_documented_problem_is_the_file_and_the_documented_commands_work(solve_json, monkeypatch):
    """Their certificates hold: of the case, against the true error."""
    monkeypatch.chdir(ROOT)
    assert (ROOT / "examples/shelter.yaml").read_text() == blocks("docs/problem-files.md")[0].text
    lines = [line.split() for line in blocks("docs/accuracy.md")[0].text.splitlines()]
    assert len(lines) == 2
    for program, *arguments in lines:
        assert program == "unilateral"
        code, found, err = solve_json(*arguments[1:])
        assert (code, err, found["certified"]) == (0, "", True)
        assert found["h1_error"] is None or found["h1_error"] <= found["total_bound"]


def test_nothing_is_relative_to_a_multiplier_that_is_0(run):
    """The search ends on a mesh that is not coarse, long before its limits."""
    code, out, _ = run("solve", "no_contact", "--accuracy", "0.5", "--norm", "hm12")
    assert code == 3
    assert "NOT certified, lambda_H is 0, and no error is a part of that; ask for an absolute accuracy" in out


@pytest.mark.parametrize("done", [0, 1])
def test_an_interrupt_leaves_the_best_solution_if_there_is_one(run, monkeypatch, done):
    """A signal in the midst of the first level, or of the second; no true errors, which may take long."""
    interrupt_in("solve", done, monkeypatch)
    code, out, err = run("solve", "natural", "--accuracy", "1e-3")
    assert (code, err) == (130, "" if done else "unilateral: interrupted\n")
    assert ("NOT certified, interrupted: ||u - u_h||_1 <= " in out) == (done > 0)
    assert ("  unknowns                    9 and" in out) == (done > 0)
    assert "||u - u_h||_1                = " not in out


@pytest.mark.usefixtures("looks")
def test_a_dry_run_says_what_is_needed(run):
    """Within 2 of what it then takes, by a run: 78366 unknowns are enough, and 45162 are not.

    Solved are the first levels only, up to 400 unknowns; on these meshes that is 1264.
    """
    dry = ("solve", "reentrant", "--accuracy", "0.015", "--dry-run", "--max-seconds", "9999")
    code, out, err = run(*dry)
    assert (code, err) == (0, "")
    (needed,) = re.findall(r"  plan: about (\S+) unknowns, \S+ s and \S+ MB, within the limits\n", out)
    assert 45162 / 2 <= float(needed) <= 2 * 78366
    assert "\n  adapted meshes, for few triangles have most of the bound\n" in out
    assert "H = 2h" in out
    levels = [line.split() for line in out.splitlines()[2:] if re.fullmatch(r"[ 0-9.e-]+", line)]
    assert [int(level[3]) for level in levels] == [21, 65, 225, 1264]
    limited = run(*dry, "--max-unknowns", "9999")[1]
    (reach,) = re.findall(
        r"; not within --max-unknowns 9999; --accuracy (0\.05|0\.1) is within reach\n", limited
    )
    found = json.loads(run(*dry, "--max-unknowns", "9999", "--json")[1])
    assert found["reach"] == float(reach)


def test_a_dry_run_as_json_and_where_nothing_is_known(run):
    """lambda_H = 0 says nothing of a part of it."""
    options = ("--dry-run", "--json", "--max-unknowns", "100", "--accuracy")
    code, out, _ = run("solve", "natural", *options, "0.01")
    found = json.loads(out)
    assert (code, list(found)) == (0, KEYS_OF_PLAN)
    assert (found["adapted"], found["missed"]) == (True, ["max_unknowns=100"])
    assert all(found[key] == float(f"{found[key]:.2g}") for key in ("unknowns", "seconds", "peak_mb"))
    code, out, _ = run("solve", "no_contact", *options, "0.5", "--norm", "hm12")
    assert (code, json.loads(out)["unknowns"]) == (0, None)
    code, out, _ = run(
        "solve", "no_contact", "--dry-run", "--accuracy", "0.5", "--norm", "hm12", *options[2:4]
    )
    assert code == 0
    assert "  plan: unknown, for nothing is known yet of the size of the solution" in out


def test_a_dry_run_that_cannot_go_on_says_why(run, problem_file_of):
    """An iteration that fails, and a wave that nobody can enclose on any mesh; as text and as JSON."""
    steps = ("natural", "--algorithm", "uzawa", "--max-steps", "1")
    of_steps = steps, "the iteration did not converge (--max-steps, "
    of_f = (problem_file_of(f="1 + cos(3200*pi*x)", g=0),), "f or g varies too fast or has terms that cancel"
    for options, why in (of_steps, of_f):
        dry = ("solve", *options, "--dry-run", "--accuracy", "0.01")
        code, out, _ = run(*dry)
        assert code == 0
        assert f"  plan: unknown, {why}" in out
        found = json.loads(run(*dry, "--json")[1])
        assert found["ended"].split("(")[0] == why.split("(")[0]
        assert found["unknowns"] is None


def test_an_interrupt_while_true_errors_are_computed_keeps_the_certificate(run, monkeypatch):
    monkeypatch.setattr(Solution, "true_errors", lambda *_: interrupt())
    code, out, err = run("solve", "natural", "--accuracy", "0.2")
    assert (code, err) == (130, "")
    assert "  certified: " in out
    assert "guaranteed  " in out


def test_a_second_interrupt_ends_at_once():
    """With code 130, before anything else is done."""
    source = (
        "import os, signal; from unilateral.accuracy.watch import Watch; "
        "from unilateral.cli.watching import watching\n"
        "with watching(Watch(), False):\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    print('once', flush=True)\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    print('twice', flush=True)\n"
    )
    found = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stdout, found.stderr) == (130, "once\n", "unilateral: interrupted\n")


def test_sigterm_is_told_and_is_code_143():
    """In one line, when the command works; the signal is sent in its first level."""
    source = (
        "import os, signal, sys; from unilateral.accuracy.watch import Watch\n"
        "from unilateral.cli import main\n"
        "Watch.begin_level = lambda _: os.kill(os.getpid(), signal.SIGTERM)\n"
        "sys.exit(main(['solve', 'natural', '--accuracy', '0.1']))\n"
    )
    found = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stdout, found.stderr) == (143, "", "unilateral: terminated\n")


def test_a_bar_on_a_terminal_and_nowhere_else(capfd, monkeypatch):
    """Of each level there is at least what clears it. No escapes, so no colours; the lines are as ever."""
    arguments = ["solve", "natural", "--accuracy", "0.2"]
    main(arguments)
    plain = capfd.readouterr()
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    main([*arguments, "--json"])
    as_json = capfd.readouterr()
    main(arguments)
    drawn = capfd.readouterr()
    assert (plain.err, as_json.err) == ("", "")
    assert drawn.err.count("\r") >= 2 * 4
    assert "\033" not in drawn.err
    assert drawn.out.splitlines()[:-1] == plain.out.splitlines()[:-1]  # the last one has the seconds


def test_the_bar_shows_the_phase_and_is_never_full():
    """5 of 10 seconds are half of 20 cells; 30 are not all, for the level goes on; 0 is not known."""
    watch = Watch(phase="solve", unknowns=4225, expected=10.0)
    assert bar(watch, 5.0) == f"  4225 unknowns: solve [{'#' * 10}{'.' * 10}] 5 s"
    assert bar(watch, 30.0) == f"  4225 unknowns: solve [{'#' * 19}.] 30 s"
    assert bar(Watch(phase="mesh"), 5.0) == f"  mesh [{'.' * 20}] 5 s"


def test_a_limit_before_the_first_level_is_told(run):
    """Nothing is solved in 1e-9 seconds, nor in the MB that are held before: code 3, one line."""
    for option in (("--max-seconds", "1e-09"), ("--max-memory", "1")):
        code, out, err = run("solve", "natural", "--accuracy", "0.1", *option)
        said = f"unilateral: {' '.join(option)} does not suffice to enclose the formulas of 'natural'\n"
        assert (code, out, err) == (3, "", said)


def test_a_limit_in_the_midst_of_the_first_level_is_told(run, monkeypatch):
    """The clock jumps at its first phase."""
    own = Watch.begin_level
    monkeypatch.setattr(Watch, "begin_level", lambda watch: (vars(watch).update(begin=-1e9), own(watch)))
    code, out, err = run("solve", "natural", "--accuracy", "0.1", "--max-seconds", "1000")
    said = "unilateral: --max-seconds 1000 does not suffice to solve on the coarsest mesh of 'square'\n"
    assert (code, out, err) == (3, "", said)


def test_where_the_data_are_0_the_table_says_what_is_wanted(run, problem_file_of):
    """The bound of `accuracy.level.NOTHING`, not 0, which no bound is below."""
    code, out, _ = run("solve", problem_file_of(f=0, g=0), "--accuracy", "0.1")
    (*_, total, wanted), head = (out.splitlines()[k].split() for k in (2, 1))
    assert (code, head[-2:]) == (0, ["total", "wanted"])
    assert float(total) <= float(wanted) == 1e-140


def test_a_refused_mesh_leaves_the_best_solution(run, solve_json, problem_file_of):
    """The coarser ones are fine; control: the code is 2 where the first one is refused."""
    polygon, refusal = "[[1e9, 0], [1e9 + 1, 0], [1e9 + 1, 1], [1e9, 1]]", "to the origin"
    file = problem_file_of(polygon=polygon, f="3*(x - 1e9) - 2", g=0)
    code, out, err = run("solve", file, "--accuracy", "1e-1")
    assert (code, err.count("\n")) == (3, 1)
    assert refusal in err
    assert re.search(r"NOT certified, the next level is refused: \|\|u - u_h\|\|_1 <= [0-9.]+e", out)
    code, found, _ = solve_json(file, "--accuracy", "1e-1")
    assert (code, found["certified"]) == (3, False)
    assert found["unknowns"] > 8
    assert run("solve", file, "--accuracy", "1e-1", "--max-unknowns", "3")[:2] == (2, "")


def test_free_sides_of_a_case_change_no_solution_but_the_count(solve_json):
    """smooth has contact on sides 0 and 1; its lambda_H is 0 on the others anyway."""
    sizes = ("smooth", "--h", "1/16", "--H", "1/8", "--tolerance", "1e-9")
    (_, held, _), (_, free, _) = (solve_json(*sizes, *of) for of in ((), ("--free-sides", "2,3")))
    assert (held["multipliers"], free["multipliers"]) == (32, 16)
    assert free["h1_error"] == pytest.approx(held["h1_error"], abs=3e-9)
    assert free["l2_error"] == pytest.approx(held["l2_error"], rel=1e-5)
    assert free["total_bound"] >= free["h1_error"]


def test_idle_sides_are_left_out_on_request(solve_json, problem_file_of):
    """f >= 1 and g < 1 on sides 0 and 3: 8 of 16 multipliers."""
    file = problem_file_of(f="1 + x*y", g="[x**2/2, 1/2 + y, x + 1/2, y/2]")
    (_, every, _), (_, left_out, _) = (
        solve_json(file, *SIZES, *of) for of in ((), ("--leave-out-idle-sides",))
    )
    assert (every["multipliers"], left_out["multipliers"]) == (16, 8)
    assert left_out["total_bound"] == pytest.approx(every["total_bound"], rel=1e-2)


@pytest.fixture
def refused(run):
    """The one sentence on standard error."""

    def refusing(*arguments):
        code, out, err = run(*arguments)
        assert (code, out) == (2, "")
        assert err.startswith("unilateral: ")
        assert err.count("\n") == 1
        assert "Traceback" not in err
        return err

    return refusing


@pytest.mark.parametrize("option", ["--h", "--H", "--rho", "--tolerance"])
@pytest.mark.parametrize(
    "text", ["0", "-1", "nan", "inf", "1/0", "abc", "1/", "", "1e-400", "1e400", "0/3", "1e999999999", "1;2"]
)
def test_a_size_must_be_a_positive_number(refused, option, text):
    message = refused("solve", "natural", *SIZES, f"{option}={text}")
    assert f"argument {option}: '{text}' must be a positive number or a fraction such as 1/64" in message


SINGULAR, ACCURATE = ("--h", "1/8", "--H", "1/8", "--rho", "1/2"), ("natural", "--accuracy", "0.1")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "missing command; see 'unilateral --help'"),
        (("draw",), "there is no command 'draw'; see 'unilateral --help'"),
        (("solve",), "PROBLEM is missing; see 'unilateral solve --help'"),
        (("solve", "natural"), "solve needs --h and --H, or --accuracy; --h is missing"),
        (("solve", "natural", "--h", "1/8"), "solve needs --h and --H, or --accuracy; --H is missing"),
        (("solve", "natural", *SIZES, "--accuracy", "0.1"), "--H is chosen by --accuracy; leave one of the"),
        (("solve", *ACCURATE, "--tolerance", "1"), "--tolerance is chosen by --accuracy"),
        (("solve", "natural", "--accuracy", "1"), "--accuracy: it is relative and must be below 1"),
        (("solve", "natural", *SIZES, "--absolute"), "--absolute is only for --accuracy"),
        (("solve", "natural", *SIZES, "--norm", "h1"), "--norm is only for --accuracy"),
        (("solve", "natural", *SIZES, "--max-seconds", "9"), "--max-seconds is only for --accuracy"),
        (
            ("solve", *ACCURATE, "--norm", "l2"),
            "argument --norm: 'l2' is none of h1, hm12; see 'unilateral solve --help'",
        ),
        (("solve", *ACCURATE, "--max-unknowns", "8"), "needs 9 unknowns; --max-unknowns"),
        (("solve", "natural", *SINGULAR), "rho has no use where S is singular"),
        (("solve", "smooth", *SIZES, "--free-sides", "1,x"), "'1,x' must be numbers of sides such as 1,2,3"),
        (("solve", "smooth", *SIZES, "--free-sides", "2,4"), "'square' has the sides 0 to 3, not 4"),
        (("solve", "smooth", *SIZES, "--free-sides", "0"), "case 'smooth' has contact on side 0"),
        (("solve", "no_contact", *SIZES, "--free-sides", "0,1,2,3"), "one side at least must not be free"),
        (("solve", "natural", *SIZES, "--leave-out-idle-sides"), "is for problem files; of a case name"),
        (("solve", PROBLEM, *SIZES, "--side", "1"), "--side is for cases; "),
        (("solve", PROBLEM, *SIZES, "--polygon", "square"), "--polygon is for cases; "),
        (("solve", PROBLEM, *SIZES, "--free-sides", "1"), "--free-sides is for cases; "),
        (("solve", PROBLEM, *SIZES, "--mesh", "structured"), "polygon 'triangle' has no structured mesh"),
        (
            ("solve", "natural", *SIZES, "--levels", "3"),
            "there is no option --levels; see 'unilateral solve --help'",
        ),
        (("solve", "natural", "--h"), "option '--h' requires an argument; see 'unilateral solve --help'"),
        (("solve", "natural", "smooth"), "got unexpected extra argument (smooth); see 'unilateral solve"),
        (("solve", "natural", *SIZES, "--js"), "there is no option --js; did you mean --json?"),
        (("solve", "two\nlines", *SIZES), "case 'two lines' is unknown"),
        (
            ("solve", "natural", "--h", "1e-7", "--H", "1/4"),
            "h = 1e-07 makes 1e+14 unknowns on 'square',",
        ),
        (("solve", "natural", "--h", "1/4", "--H", "1e-6"), "16 of them on the boundary, take about"),
        (("solve", "thirds", *SIZES, "--polygon", "disc"), "polygon 'disc' is unknown; the named ones are"),
        (("solve", "thirds", *SIZES, "--side", "left"), "argument --side: 'left' is not a valid integer"),
        (
            ("solve", "natural", *SIZES, "--mesh", "quads"),
            "'quads' is neither structured nor unstructured nor",
        ),
        (
            ("solve", "natural", *SIZES, "--algorithm", "simplex"),
            "argument --algorithm: 'simplex' is none of auto, uzawa",
        ),
        (("solve", "natural", *SIZES, "--max-steps", "0"), "'0' must be a whole number of at least 1"),
        (
            ("solve", "natural", "--h", "0,5", "--H", "1"),
            "number or a fraction such as 1/64; write 0.5 for 0,5",
        ),
        (("solve", "natural", *SIZES, "--max-steps", "1.5"), "'1.5' must be a whole number of at least 1"),
    ],
)
def test_bad_arguments(refused, arguments, message):
    assert message in refused(*arguments)


OWN_PROBLEM = "polygon: [[0, 0], [1, 0], [0, 1]]\nf: 1\ng: 0\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (OWN_CASE.replace("title", "titel"), "there is no field 'titel' here"),
        (OWN_CASE.replace("formula: ", "formula: -"), "lambda = du/dn < 0"),
        ("\x00", "is not a YAML file"),
        ("a: [1, 2", "is not a YAML file"),
        ("# λ\ng:\n\t- 0\n", "is not a YAML file: there is a tab in line 3; write spaces"),
        ("g: [a,\t1", "is not a YAML file: while parsing a flow sequence in line 1"),
        ("f: !!int x", "own.yaml: 'tag:yaml.org,2002:int' in line 1 is a tag; write the value alone"),
        (f"{OWN_PROBLEM}? {'k' * 100_000}\n: 1\n", f"there is no field '{'k' * 57}...' here; the fields are"),
        (f"{OWN_PROBLEM}title: [{'[1], ' * 2000}]\n", f"field title: it is [{'[1], ' * 11}[...; it"),
    ],
    ids=["typo", "not a solution", "binary", "half", "tab", "tab elsewhere", "tag", "long name", "long list"],
)
def test_bad_files(refused, tmp_path, content, message):
    """What else a file may have is refused in the tests of declarations, cases and problems."""
    file = tmp_path / "own.yaml"
    file.write_text(content)
    assert message in refused("solve", str(file), *SIZES)


def alone(*arguments, shell="", **environment):
    """The command in a process of its own; `shell` redirects its streams."""
    command = f"{SCRIPT} {' '.join(arguments)} {shell}"
    environment = {**os.environ, **environment}
    found = subprocess.run(["sh", "-c", command], capture_output=True, env=environment, timeout=60, cwd=ROOT)
    return found.returncode, found.stdout, found.stderr.decode()


def test_the_installed_command():
    code, out, err = alone("solve", "full_contact", *SIZES, "--json")
    assert (code, err, list(json.loads(out))) == (0, "", KEYS)
    code, out, err = alone("solve", "unknown.yaml", *SIZES)
    assert (code, out, err.count("\n")) == (2, b"", 1)


@pytest.mark.parametrize(
    ("arguments", "unbuffered"),
    [(("solve", "--help"), ""), (("solve", "--help"), "1"), (("solve", "full_contact", *SIZES), "1")],
)
def test_a_closed_pipe_is_no_error(arguments, unbuffered):
    """Written at the end or line by line; gmsh, which resets SIGPIPE, is imported by `solve`."""
    reader, writer = os.pipe()
    os.close(reader)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    try:
        found = subprocess.run(
            [SCRIPT, *arguments], stdout=writer, stderr=subprocess.PIPE, env=environment, timeout=60
        )
    finally:
        os.close(writer)
    assert (found.returncode, found.stderr) == (0, b"")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A problem of one's own, which needs the fewest imports, see below."""
    file = tmp_path_factory.mktemp("small") / "small.yaml"
    file.write_text("polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: 1\ng: 0\n")
    return str(file)


@pytest.mark.parametrize("command", ["help", "solve"])
@pytest.mark.parametrize(
    ("shell", "unbuffered", "message"),
    [
        (">/dev/full", "", "No space left on device"),
        (">/dev/full", "1", "No space left on device"),
        (">&-", "", "standard output is closed"),
    ],
    ids=["full", "full at once", "closed"],
)
def test_output_that_cannot_be_written_is_code_4(small, command, shell, unbuffered, message):
    """A full disk is what writing to /dev/full gives, see full(4); without a buffer it is met earlier."""
    arguments = ("--help",) if command == "help" else ("solve", small, *SIZES)
    found = alone(*arguments, shell=shell, PYTHONUNBUFFERED=unbuffered)
    assert found == (4, b"", f"unilateral: the system failed: {message}\n")


@pytest.mark.parametrize("shell", ["2>&-", "2>/dev/full"])
def test_messages_that_cannot_be_written_change_no_code(small, shell):
    """And do not go to standard output; the solve warns, the other one is refused."""
    assert alone("solve", "unknown.yaml", *SIZES, shell=shell)[:2] == (2, b"")
    code, out, _ = alone("solve", small, "--h", "1/4", "--H", "1/8", "--json", shell=shell)
    assert code == 0
    assert list(json.loads(out)) == KEYS
    assert alone("--help", shell=f"{shell} >/dev/full")[0] == 4


TITLE = "λ-λ_H ‖·‖ – 90° š…"


@pytest.mark.parametrize(
    ("encoding", "letters"),
    [
        ("utf-8", TITLE),
        ("cp1252", "lambda-lambda_H ||·|| – 90° š…"),
        ("latin-1", r"lambda-lambda_H ||·|| - 90° \u0161\u2026"),
        ("ascii", r"lambda-lambda_H ||*|| - 90 degrees \u0161\u2026"),
        ("ascii:replace", "?-?_H ??? ? 90? ??"),
    ],
)
def test_letters_that_a_terminal_does_not_have(tmp_path, encoding, letters):
    """By their names, or their codes; a user's own choice, such as ascii:replace, is left."""
    source = f"from unilateral.cli import streams; streams.prepare(); streams.say({TITLE!r})"
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    found = subprocess.run([sys.executable, "-c", source], capture_output=True, env=environment, timeout=60)
    assert (found.returncode, found.stderr) == (0, b"")
    assert found.stdout.decode(encoding.split(":")[0]).splitlines() == [letters]


def test_a_file_s_name_that_is_no_text_is_printed(tmp_path, problem_file_of):
    """Bytes that are not UTF-8, which Python keeps as surrogates."""
    file = os.fsencode(tmp_path) + b"/\xff.yaml"
    os.rename(problem_file_of(f=1, g=0), file)
    found = subprocess.run([SCRIPT, "solve", file, *SIZES], capture_output=True, timeout=60)
    assert (found.returncode, found.stderr) == (0, b"")
    assert found.stdout.startswith(rb"\udcff: h = ")


SLOW = {
    *("numpy", "scipy", "sympy", "gmsh", "skfem", "xarray", "pandas", "matplotlib", "jsonschema", "yaml"),
    *("pyamg", "meshio", "netCDF4", "scipy.spatial", "scipy.optimize", "importlib.metadata"),
}
"""What takes long to import."""


@pytest.mark.parametrize(
    ("imported", "run"),
    [
        ("unilateral", "None"),
        ("unilateral.cli", "None"),
        ("unilateral.cli", "unilateral.cli.main(['--help'])"),
        *(("unilateral.cli", f"unilateral.cli.main(['{name}', '--help'])") for name in COMMANDS),
    ],
    ids=["library", "entry", "help", *COMMANDS],
)
def test_what_comes_at_once_imports_next_to_nothing(imported, run):
    """The library's names are imported when they are asked for; `main` is there to be interrupted."""
    assert found_imported(imported, run) == set()


def test_a_small_problem_of_one_s_own_imports_what_it_needs(problem_file_of):
    """Neither what derives cases nor what draws, meshes, refines, tabulates or solves large systems."""
    formulas = {"f": "3 - 8*x*y - pi**2*sin(3*pi*x) + pos(x - 1/3, 0)", "g": "x*(1 - x)/3 - y*(1 - y)/5"}
    solve = ["solve", str(problem_file_of(**formulas)), *SIZES]
    found = found_imported("unilateral.cli", f"unilateral.cli.main({solve})")
    assert found - {"importlib.metadata"} == {"numpy", "scipy", "jsonschema", "yaml"}  # which numpy imports


def test_what_needs_it_is_imported():
    """Control: a command that runs imports what it works with, here to refuse a name."""
    found = found_imported("unilateral.cli", "unilateral.cli.main(['cases', 'naturall'])")
    assert {"numpy", "sympy", "yaml"} <= found


def found_imported(imported, run):
    """Which of the slow modules a process has imported after an import and a call."""
    source = f"import sys, {imported}; {run}; print('', *{SLOW} & set(sys.modules))"
    return set(in_a_process(source).splitlines()[-1].split())


@pytest.mark.parametrize("module", ["unilateral.cli", "unilateral.cli.streams", "difflib", "numpy"])
def test_an_interrupt_while_the_command_begins_ends_it_in_one_line(module):
    """While it imports that; the installed command begins with `unilateral.__main__`."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["scripts"] == {"unilateral": "unilateral.__main__:main"}
    source = (
        "import os, signal, sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, *_):\n"
        f"        name == {module!r} and os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from unilateral.__main__ import main\n"
        "sys.argv[1:] = ['cases']\n"
        "main()\n"
    )
    found = subprocess.run([sys.executable, "-c", source], capture_output=True, text=True, timeout=60)
    assert (found.returncode, found.stdout, found.stderr) == (130, "", "unilateral: interrupted\n")


@pytest.mark.parametrize(
    ("fault", "outcome"),
    [
        ("os.kill(os.getpid(), signal.SIGINT)", (130, b"", "unilateral: interrupted\n")),
        ("raise ImportError('libx is missing')", (4, b"", "ImportError: libx is missing (numpy.py, line 5)")),
        ("raise OSError(5, 'Input/output error', 'x.so')", (4, b"", "failed: x.so: Input/output error\n")),
    ],
    ids=["interrupt", "missing", "unreadable"],
)
def test_a_library_that_cannot_be_imported(tmp_path, fault, outcome):
    """A library in the place of numpy which, as some written in C do, makes another error of an interrupt."""
    other = "except KeyboardInterrupt:\n    raise ImportError from None\n"
    (tmp_path / "numpy.py").write_text(f"import os, signal\n\n\ntry:\n    {fault}\n{other}")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    code, out, err = alone("cases", PYTHONPATH=path)
    assert (code, out, err.count("\n")) == (*outcome[:2], 1)
    assert outcome[2] in err


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "the memory does not suffice; take larger sizes --h and --H"),
        (OSError(28, "No space left on device", "a.nc"), "failed: a.nc: No space left on device"),
        (RuntimeError("NetCDF: HDF error"), "RuntimeError: NetCDF: HDF error (test_cli.py, line "),
    ],
    ids=["memory", "disk", "HDF"],
)
def test_a_failure_in_the_midst_is_code_4(run, monkeypatch, error, message):
    """And not 1, which is a claim that fails."""

    def failing(*_):
        raise error

    monkeypatch.setattr(claims, "judge", failing)
    code, out, err = run("claims", "4.12")
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert message in err


def test_a_failure_in_code_without_a_file_is_told(run, monkeypatch):
    """As numpy functions are that sympy makes: their place has no module's name."""
    source = "def failing(*_):\n    raise ArithmeticError('no number')\n"
    made = {"__builtins__": __builtins__}
    exec(compile(source, "<lambdifygenerated-1>", "exec"), made)
    del made["__builtins__"]
    monkeypatch.setattr(claims, "judge", made["failing"])
    code, _, err = run("claims", "4.12")
    assert (code, err.count("\n")) == (4, 1)
    assert err.endswith("ArithmeticError: no number (<lambdifygenerated-1>, line 2)\n")


def test_warnings_are_as_before_afterwards(run):
    before = warnings.showwarning
    run("solve", "unknown", *SIZES)
    assert warnings.showwarning is before


def test_a_bound_that_does_not_fit_into_the_memory_is_left_out(run, monkeypatch):
    """1089 unknowns take 1 MB, and by the sharp bound 5; control: the cheap one."""
    monkeypatch.setattr("unilateral.cli.solve.available_mb", lambda: 2.0)
    sizes = "--h", "1/32", "--H", "1/16"
    code, out, err = run("solve", "no_contact", *sizes, "--sharp")
    assert (code, err) == (0, "unilateral: no guaranteed bound, for it takes about 5 MB, and 2 MB are free\n")
    assert "guaranteed  " not in out
    assert "guaranteed  " in run("solve", "no_contact", *sizes)[1]
