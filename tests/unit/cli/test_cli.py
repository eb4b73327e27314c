"""The command line: what it prints, where, and with which exit code."""

import json
import os
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, discrete, load

from unilateral import cli
from unilateral import discrete as of_data
from unilateral.accuracy import search as searching
from unilateral.accuracy.search import levels
from unilateral.bounds.source import enclosed
from unilateral.bounds.total import total_bound
from unilateral.cli import main
from unilateral.norms.dual import dual_norm
from unilateral.problems import case
from unilateral.study.judge import claims

IDLE = """\
polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]
f: 1 + x*y
g: [x**2/2, 1/2 + y, x + 1/2, y/2]
"""
KEYS = [  # of --json, in the documented order
    *("problem", "h", "diameter", "H", "unknowns", "multipliers", "iterations", "converged"),
    *("algebraic_bound", "h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error", "total_bound"),
    *("seconds", "peak_mb"),
]
NOT_UNIQUE = "unilateral: lambda_H may not be unique, for beta = 0; take h < H, such as H = 2h\n"
SIZES = ("--h", "1/8", "--H", "1/4")
PROBLEM = str(ROOT / "tests/data/problems/triangle.yaml")
SCRIPT = Path(sys.executable).with_name("unilateral")
SQUARE = "polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: 1\ng: 0\n"
DEGREE = "(((x+y)/9)**100)**100 - (((x+y)/9)**100)**99"
NESTED = "sin(" * 190 + "x" + ")" * 190
DECLARATION = """\
title: contact everywhere
polygons: any
u: [{ atom: smooth, formula: (x - 1/2)**2 + (y - 1/2)**2 }]
gap: { elsewhere: 0 }
hypotheses: { j: true, jj: true, jjj: true }
asymptotic: { reason: none, h1: { from: 1 }, hm12: { from: 1 }, l2: { from: 1 } }
"""


def run(capsys, *arguments):
    code = main(list(arguments))
    out, err = capsys.readouterr()
    return code, out, err


def as_json(capsys, *arguments):
    code, out, err = run(capsys, "solve", *arguments, "--json")
    assert out.count("\n") == 1
    return code, json.loads(out), err


def in_a_process(source):
    command = [sys.executable, "-c", source]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout


def test_cases_lists_the_catalogue_with_its_certificates(capsys):
    code, out, err = run(capsys, "cases")
    assert (code, err) == (0, "")
    for name in case.names():
        declaration = case.declared(name)[0]
        rows = [line.split() for line in out.splitlines() if line.startswith(f"{name} ")]
        on = ["square", "lshape"] if declaration["polygons"] == "any" else declaration["polygons"]
        assert [row[-1] for row in rows] == on
        hypotheses = ["yes" if value else "no" for value in declaration["hypotheses"].values()]
        assert all(row[1:4] == hypotheses for row in rows)
        assert declaration["title"] in out
    assert re.search(r"natural .* 0: 0\.5-1; sides 1, 2, 3 +square", out)


def test_solve_prints_a_table(capsys):
    code, out, err = run(capsys, "solve", "natural", "--h", "1/16", "--H", "1/8")
    assert (code, err) == (0, "")
    assert out.startswith("natural: h = 0.0625, H = 0.125, h/H = 0.5\n")
    solution = of_data.solve(discrete("natural", 16, 8))
    assert f"uzawa converged             algebraic error <= {solution.result.bound:.4e}" in out
    assert f"after {solution.result.iterations} steps" in out
    for name, sign, value in (("u - u_h||_1", "=", "h1"), ("lambda - lambda_H||_0", "=", "l2")):
        assert re.search(rf"\|\|{re.escape(name)} +{sign} {getattr(solution.errors, value):.4e}\n", out), name
    bounds = re.search(r"\|\|lambda - lambda_H\|\|_-1/2 +>= (\S+), <= (\S+)\n", out)
    assert bounds is not None
    lower, upper = map(float, bounds.groups())
    assert solution.errors.hm12_discrete <= lower * (1 + 1e-4)
    assert lower < upper <= 1.05 * lower


def test_json_has_the_documented_keys_and_the_library_s_numbers(capsys):
    code, found, err = as_json(capsys, "natural", "--h", "1/16", "--H", "1/8")
    assert (code, err) == (0, "")
    assert list(found) == KEYS
    alone = discrete("natural", 16, 8)
    solution = of_data.solve(alone)
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
        "h1_error": solution.errors.h1,
        "l2_error": solution.errors.l2,
    }
    norm = dual_norm(alone.spaces.partition, [load("natural")])
    lower, upper = norm.of_error(load("natural"), solution.lambda_H[None])
    expected |= {"hm12_error_lower": lower[0], "hm12_error_upper": upper[0]}
    f, g = enclosed(alone.exact.ritz.condensed.mesh, load("natural")), load("natural").enclosed_obstacle
    bound = total_bound(f, g, alone.spaces.partition, solution.u_h, solution.lambda_H)
    expected["total_bound"] = bound.u
    for key, value in expected.items():
        assert found[key] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), key
    assert found["seconds"] > 0
    assert found["peak_mb"] > 1


def test_a_multiplier_outside_L2_has_a_lower_bound_and_no_other_number(capsys):
    """And beta is not what is to blame."""
    code, out, err = run(capsys, "solve", "rough", "--h", "1/16", "--H", "1/8")
    assert (code, err) == (0, "")
    dual, l2 = (line for line in out.splitlines() if "  ||lambda - lambda_H" in line)
    assert ">= " in dual
    assert "<=" not in dual
    assert l2.endswith("= none, for lambda is not in L2")
    assert "beta" not in out


def test_json_is_null_where_beta_is_0(capsys):
    """At H = h the multiplier is not judged; the active set, which ran, counts no steps."""
    code, found, err = as_json(capsys, "natural", "--h", "1/8", "--H", "1/8")
    assert (code, err) == (0, NOT_UNIQUE)
    assert list(found) == KEYS
    unknown = [key for key in KEYS if found[key] is None]
    assert unknown == ["iterations", "hm12_error_lower", "hm12_error_upper", "l2_error"]
    assert found["h1_error"] == pytest.approx(of_data.solve(discrete("natural", 8, 8)).errors.h1, rel=1e-9)


@pytest.mark.parametrize("problem", ["natural", PROBLEM])
def test_a_multiplier_that_may_not_be_unique_is_said(capsys, problem):
    """With more cells than boundary nodes beta = 0, whatever the mesh; control: it is positive at H = 2h."""
    code, out, err = run(capsys, "solve", problem, "--h", "1/8", "--H", "1/16")
    assert (code, err) == (0, NOT_UNIQUE)
    assert f"\n  lambda_H                    {NOT_UNIQUE.split('lambda_H ')[1]}" in out
    assert as_json(capsys, problem, "--h", "1/8", "--H", "1/16")[::2] == (0, NOT_UNIQUE)
    code, out, err = run(capsys, "solve", problem, "--h", "1/8", "--H", "1/4")
    assert (code, err) == (0, "")
    assert "unique" not in out


def test_the_table_says_where_beta_is_0(capsys):
    _, out, _ = run(capsys, "solve", "natural", "--h", "1/8", "--H", "1/8")
    assert out.count("not judged, for beta = 0") == 2
    assert "active_set converged" in out
    assert "steps" not in out


@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov", "active_set"])
def test_all_algorithms_agree(capsys, algorithm):
    """Each within its own guaranteed bound of the same solution, in the norm of u's error."""
    code, found, _ = as_json(capsys, "thirds", "--h", "1/16", "--H", "1/8", "--algorithm", algorithm)
    assert code == 0
    exact = of_data.solve(discrete("thirds", 16, 8))
    assert abs(found["h1_error"] - exact.errors.h1) <= found["algebraic_bound"] + exact.result.bound
    assert (found["iterations"] is None) == (algorithm == "active_set")


def test_the_lshape_and_a_side(capsys):
    found = [as_json(capsys, "thirds", *SIZES, "--polygon", "lshape", "--side", side)[1] for side in "02"]
    assert [each["unknowns"] for each in found] == [3 * 64 + 4 * 8 + 1] * 2
    assert [each["multipliers"] for each in found] == [32] * 2
    assert found[0]["h1_error"] != found[1]["h1_error"]


def test_an_unstructured_mesh(capsys):
    code, found, _ = as_json(capsys, "natural", *SIZES, "--mesh", "unstructured")
    assert code == 0
    assert found["h"] == pytest.approx(1 / 8, rel=1e-12)
    assert found["unknowns"] != 81


def test_a_case_of_one_s_own(capsys, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text(DECLARATION)
    code, found, err = as_json(capsys, str(file), *SIZES)
    assert (code, err, found["problem"]) == (0, "", "own")


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov"])
def test_too_few_steps_end_with_code_3_and_a_message(capsys, algorithm):
    options = ("natural", *SIZES, "--max-steps", "1", "--algorithm", algorithm)
    code, found, err = as_json(capsys, *options)
    assert (code, found["converged"], found["iterations"]) == (3, False, 1)
    assert re.fullmatch(
        rf"unilateral: {algorithm} stopped after 1 steps with .* above the tolerance .*\n", err
    )
    code, out, _ = run(capsys, "solve", *options)
    assert code == 3
    assert f"{algorithm} NOT converged" in out


def test_rho_and_tolerance_are_obeyed(capsys):
    _, loose, _ = as_json(capsys, "natural", *SIZES, "--tolerance", "1e-2", "--rho", "1/4")
    _, tight, _ = as_json(capsys, "natural", *SIZES, "--tolerance", "1e-8", "--rho", "1/4")
    _, default, _ = as_json(capsys, "natural", *SIZES, "--tolerance", "1e-8")
    assert tight["algebraic_bound"] <= 1e-8 < loose["algebraic_bound"] <= 1e-2
    assert loose["iterations"] < tight["iterations"]
    assert default["iterations"] < tight["iterations"]


def test_the_total_bound_holds_and_is_sharp(capsys):
    """natural at h = 1/16: at least the error, and at most a tenth more."""
    _, found, _ = as_json(capsys, "natural", "--h", "1/16", "--H", "1/8")
    assert found["h1_error"] <= found["total_bound"] <= 1.1 * found["h1_error"]


def test_an_accuracy_of_a_case(capsys):
    code, found, err = as_json(capsys, "natural", "--accuracy", "1e-1")
    assert (code, err, list(found)) == (0, "", KEYS)
    assert found["converged"] is True
    assert found["h1_error"] <= found["total_bound"] <= 0.5
    assert found["h"] == found["H"] / 2
    _, out, _ = run(capsys, "solve", "natural", "--accuracy", "1e-1")
    lines = out.splitlines()
    assert lines[0] == "natural: ||u - u_h||_1 <= 0.1 ||u||_1"
    levels = [line.split() for line in lines[2:] if re.fullmatch(r"[ 0-9.e-]+", line)]
    assert [float(level[0]) for level in levels][:2] == [0.5, 0.25]
    assert int(levels[-1][2]) == found["unknowns"]
    assert sum(int(level[4]) for level in levels) == found["iterations"]
    assert re.search(rf"  certified: .* <= {found['total_bound']:.4e} = 0.0\d+ of \|\|u\|\|_1 >= ", out)


def written(folder, f, g="0"):
    """A problem on the unit square."""
    file = folder / "own.yaml"
    file.write_text(f"polygon: [[0, 0], [1, 0], [1, 1], [0, 1]]\nf: {f}\ng: {g}\n")
    return str(file)


HIDDEN = "1 + 9/10*exp(-2500*((x - 409/500)**2 + (y - 397/500)**2))"
"""A peak between the points of the rules that were once used: 9 unknowns were certified to 1.6e-8."""


def test_a_peak_that_hides_from_rules_is_not_certified_too_early(capsys, tmp_path):
    """The best approximation of u on 9 nodes is 6.3e-4 away (an independent computation); lambda is 0."""
    file = written(tmp_path, HIDDEN)
    code, found, _ = as_json(capsys, file, "--accuracy", "1e-4")
    assert (code, found["converged"]) == (0, True)
    assert found["unknowns"] > 1000
    _, coarse, _ = as_json(capsys, file, "--h", "1/2", "--H", "1")
    assert coarse["total_bound"] >= 6.3e-4
    of_lambda = (file, "--accuracy", "1e-4", "--norm", "hm12", "--max-unknowns", "300")
    assert as_json(capsys, *of_lambda)[0] == 3


def test_the_output_says_what_the_guarantee_rests_on(capsys):
    _, out, _ = run(capsys, "solve", "natural", "--accuracy", "1e-1")
    (line,) = re.findall(r"  the guarantee rests on +(.*)", out)
    assert re.fullmatch(r"f and g enclosed, which adds [0-9.e-]+; exact .*; nothing sampled", line)


def test_what_cannot_be_enclosed_is_not_guaranteed(capsys, tmp_path):
    """A wave too short for the pieces: code 3, and what samples would certify is called an estimate."""
    code, out, _ = run(capsys, "solve", written(tmp_path, "1 + cos(3200*pi*x)"), "--accuracy", "1e-2")
    assert code == 3
    assert re.search(r"NOT guaranteed, for f or g varies too fast .*the rest, is an estimate", out)


def test_a_withdrawn_bound_is_told(capsys, monkeypatch):
    """The first level's is 1000 times too small, the third one's contradicts it: the second is the answer."""
    own, factors = of_data.total_bound, iter([1e-3, 1e-3])

    def spoilt(*arguments):
        found, factor = own(*arguments), next(factors, 1.0)
        return replace(found, u=factor * found.u, lambda_=factor * found.lambda_)

    monkeypatch.setattr(of_data, "total_bound", spoilt)
    code, out, err = run(capsys, "solve", "natural", "--accuracy", "1e-4", "--max-unknowns", "300")
    assert code == 3
    assert err == "unilateral: 2 bounds withdrawn, for they contradict each other; please report it\n"
    assert "NOT certified, bounds contradict each other: " in out
    assert "  unknowns                    25 and" in out


def test_an_accuracy_that_another_level_contradicts_is_not_certified(capsys, monkeypatch):
    """The third level's would be small enough, and the first one's of lambda is 1000 times too small."""
    own, factors = of_data.total_bound, iter([1e-3, 1e-3])

    def spoilt(*arguments):
        found = own(*arguments)
        return replace(found, lambda_=next(factors, 1.0) * found.lambda_)

    monkeypatch.setattr(of_data, "total_bound", spoilt)
    code, out, _ = run(capsys, "solve", "natural", "--accuracy", "0.05")
    assert (code, "  certified: " in out) == (3, False)
    assert "  unknowns                    25 and" in out


def test_where_all_bounds_are_withdrawn_none_is_told(capsys, monkeypatch):
    """Each is 1000 times too small."""
    own = of_data.total_bound

    def spoilt(*arguments):
        found = own(*arguments)
        return replace(found, lambda_=1e-3 * found.lambda_)

    monkeypatch.setattr(of_data, "total_bound", spoilt)
    code, out, _ = run(capsys, "solve", "natural", "--accuracy", "0.05")
    assert code == 3
    assert "NOT certified, bounds contradict each other: no bound is left" in out
    assert "the guarantee rests on" not in out


def test_an_accuracy_of_a_problem_in_the_dual_norm(capsys):
    code, found, _ = as_json(capsys, PROBLEM, "--accuracy", "0.2", "--norm", "hm12")
    assert (code, found["problem"]) == (0, "triangle")
    assert [key for key in KEYS if found[key] is None] == [key for key in KEYS if "_error" in key]


def test_given_sizes_of_a_problem(capsys):
    code, found, err = as_json(capsys, PROBLEM, *SIZES)
    assert (code, err, list(found)) == (0, "", KEYS)
    assert found["h"] <= 1 / 8 < found["h"] * 2
    assert found["algebraic_bound"] <= 0.01 * found["total_bound"]
    _, out, _ = run(capsys, "solve", PROBLEM, *SIZES)
    assert f"guaranteed                  ||u - u_h||_1 <= {found['total_bound']:.4e}" in out
    assert "lambda_H||_0" not in out


@pytest.mark.parametrize(("option", "value"), [("--max-unknowns", "100"), ("--max-seconds", "1e-09")])
def test_a_budget_that_ends_is_code_3(capsys, option, value):
    arguments = ("solve", "natural", "--accuracy", "1e-3", option, value)
    code, out, err = run(capsys, *arguments)
    assert (code, err) == (3, "")
    assert re.search(rf"NOT certified, out of budget \(.*{option} {value}.*\): \|\|u - u_h\|\|_1 <= ", out)
    code, found, _ = as_json(capsys, *arguments[1:])
    assert (code, found["converged"]) == (3, False)
    assert found["total_bound"] >= found["h1_error"]


def blocks(page):
    """The code blocks of a page of docs/, and their kinds."""
    return re.findall(r"^```(\w*)\n(.*?)^```", (ROOT / page).read_text(), re.MULTILINE | re.DOTALL)


def test_the_documented_problem_is_the_file_and_the_documented_commands_work(capsys, monkeypatch):
    """Their certificates hold: of the case, against the true error."""
    monkeypatch.chdir(ROOT)
    assert ("yaml", (ROOT / "examples/shelter.yaml").read_text()) in blocks("docs/problem-files.md")
    commands = [line.split() for line in blocks("docs/accuracy.md")[0][1].splitlines()]
    assert len(commands) == 2
    for program, *arguments in commands:
        assert program == "unilateral"
        code, found, err = as_json(capsys, *arguments[1:])
        assert (code, err, found["converged"]) == (0, "", True)
        assert found["h1_error"] is None or found["h1_error"] <= found["total_bound"]


def test_nothing_is_relative_to_a_multiplier_that_is_0(capsys):
    code, out, _ = run(
        capsys, "solve", "no_contact", "--accuracy", "0.5", "--norm", "hm12", "--max-unknowns", "100"
    )
    assert code == 3
    assert "lambda_H is 0, nothing is relative to it" in out


def test_an_interrupt_leaves_the_best_solution(capsys, monkeypatch):
    def interrupted(*arguments):
        found = levels(*arguments)
        yield next(found)
        raise KeyboardInterrupt

    monkeypatch.setattr(searching, "levels", interrupted)
    code, out, err = run(capsys, "solve", "natural", "--accuracy", "1e-3")
    assert (code, err) == (130, "")
    assert "NOT certified, interrupted: ||u - u_h||_1 <= " in out


@pytest.mark.parametrize(
    ("polygon", "f", "refusal"),
    [
        ("[[0, 0], [1/1000, 0], [1/1000, 1/1000], [0, 1/1000]]", "3*x - 2", "too small for double precision"),
        ("[[1e9, 0], [1e9 + 1, 0], [1e9 + 1, 1], [1e9, 1]]", "3*(x - 1e9) - 2", "to the origin"),
    ],
)
def test_a_refused_mesh_leaves_the_best_solution(capsys, tmp_path, polygon, f, refusal):
    """The coarser ones are fine; control: the code is 2 where the first one is refused."""
    file = tmp_path / "own.yaml"
    file.write_text(f"polygon: {polygon}\nf: {f}\ng: 0\n")
    code, out, err = run(capsys, "solve", str(file), "--accuracy", "1e-1")
    assert (code, err.count("\n")) == (3, 1)
    assert refusal in err
    assert re.search(r"NOT certified, the next level is refused: \|\|u - u_h\|\|_1 <= [0-9.]+e", out)
    code, found, _ = as_json(capsys, str(file), "--accuracy", "1e-1")
    assert (code, found["converged"]) == (3, False)
    assert found["unknowns"] > 8
    assert run(capsys, "solve", str(file), "--accuracy", "1e-1", "--max-unknowns", "3")[:2] == (2, "")


def test_an_interrupt_before_there_is_one(capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(searching, "levels", interrupted)
    assert run(capsys, "solve", "natural", "--accuracy", "1e-3") == (130, "", "unilateral: interrupted\n")


def test_free_sides_of_a_case_change_no_solution_but_the_count(capsys):
    """smooth has contact on sides 0 and 1; its lambda_H is 0 on the others anyway."""
    sizes = ("--h", "1/32", "--H", "1/16", "--tolerance", "1e-9")
    _, held, _ = as_json(capsys, "smooth", *sizes)
    _, free, _ = as_json(capsys, "smooth", *sizes, "--free-sides", "2,3")
    assert (held["multipliers"], free["multipliers"]) == (64, 32)
    assert free["h1_error"] == pytest.approx(held["h1_error"], abs=3e-9)
    assert free["l2_error"] == pytest.approx(held["l2_error"], rel=1e-5)
    assert free["total_bound"] >= free["h1_error"]


def test_idle_sides_are_left_out_on_request(capsys, tmp_path):
    """f >= 1 and g < 1 on sides 0 and 3: 8 of 16 multipliers."""
    file = tmp_path / "own.yaml"
    file.write_text(IDLE)
    _, all_sides, _ = as_json(capsys, str(file), *SIZES)
    _, left_out, _ = as_json(capsys, str(file), *SIZES, "--leave-out-idle-sides")
    assert (all_sides["multipliers"], left_out["multipliers"]) == (16, 8)
    assert left_out["total_bound"] == pytest.approx(all_sides["total_bound"], rel=1e-2)


def refused(capsys, *arguments):
    """The one sentence on standard error."""
    code, out, err = run(capsys, *arguments)
    assert (code, out) == (2, "")
    assert err.startswith("unilateral: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


BAD_SIZES = [
    "0",
    "-1",
    "nan",
    "inf",
    "1/0",
    "abc",
    "1/",
    "",
    "1e-400",
    "1e400",
    "0/3",
    "1e999999999",
    "x",
    "1;2",
]


@pytest.mark.parametrize("option", ["--h", "--H", "--rho", "--tolerance"])
@pytest.mark.parametrize("text", BAD_SIZES)
def test_a_size_must_be_a_positive_number(capsys, option, text):
    message = refused(capsys, "solve", "natural", *SIZES, f"{option}={text}")
    assert f"argument {option}: '{text}' must be a positive number or a fraction such as 1/64" in message


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "required: COMMAND"),
        (("draw",), "invalid choice: 'draw'"),
        (("solve",), "required: PROBLEM"),
        (("solve", "natural"), "solve needs --h and --H, or --accuracy; --h is missing"),
        (("solve", "natural", "--h", "1/8"), "solve needs --h and --H, or --accuracy; --H is missing"),
        (("solve", "natural", *SIZES, "--accuracy", "0.1"), "--H is chosen by --accuracy; leave one of the"),
        (
            ("solve", "natural", "--accuracy", "0.1", "--tolerance", "1"),
            "--tolerance is chosen by --accuracy",
        ),
        (("solve", "natural", "--accuracy", "1"), "--accuracy: it is relative and must be below 1"),
        (("solve", "natural", *SIZES, "--norm", "h1"), "--norm is only for --accuracy"),
        (("solve", "natural", *SIZES, "--max-seconds", "9"), "--max-seconds is only for --accuracy"),
        (("solve", "natural", "--accuracy", "0.1", "--norm", "l2"), "invalid choice: 'l2'"),
        (
            ("solve", "natural", "--h", "1/8", "--H", "1/8", "--rho", "1/2"),
            "rho has no use where S is singular",
        ),
        (
            ("solve", "natural", "--accuracy", "0.1", "--max-unknowns", "8"),
            "needs 9 unknowns; --max-unknowns",
        ),
        (("solve", "smooth", *SIZES, "--free-sides", "1,x"), "'1,x' must be numbers of sides such as 1,2,3"),
        (("solve", "smooth", *SIZES, "--free-sides", "2,4"), "'square' has the sides 0 to 3, not 4"),
        (("solve", "smooth", *SIZES, "--free-sides", "0"), "case 'smooth' has contact on side 0"),
        (("solve", "no_contact", *SIZES, "--free-sides", "0,1,2,3"), "one side at least must not be free"),
        (("solve", "natural", *SIZES, "--leave-out-idle-sides"), "is for problem files; of a case name"),
        (("solve", PROBLEM, *SIZES, "--side", "1"), "--side is for cases; "),
        (("solve", PROBLEM, *SIZES, "--polygon", "square"), "--polygon is for cases; "),
        (("solve", PROBLEM, *SIZES, "--free-sides", "1"), "--free-sides is for cases; "),
        (("solve", PROBLEM, *SIZES, "--mesh", "structured"), "polygon 'triangle' has no structured mesh"),
        (("solve", "natural", *SIZES, "--levels", "3"), "unrecognized arguments: --levels 3"),
        (("solve", "natural", *SIZES, "--js"), "unrecognized arguments: --js"),
        (("solve", "unknown", *SIZES), "case 'unknown' is unknown; the catalogue has borderline_0.05,"),
        (("solve", "two\nlines", *SIZES), "case 'two lines' is unknown"),
        (
            ("solve", "natural", "--h", "1/2000", "--H", "1/4"),
            "h = 0.0005 is too fine for 'square'; it must be at",
        ),
        (
            ("solve", "natural", "--h", "1/4", "--H", "1/2000"),
            "H = 0.0005 is too fine for 'square'; it must be at",
        ),
        (("solve", "natural", *SIZES, "--polygon", "lshape"), "'natural' is for square, not for 'lshape'"),
        (("solve", "thirds", *SIZES, "--polygon", "disc"), "polygon 'disc' is unknown; the named ones are"),
        (("solve", "thirds", *SIZES, "--side", "4"), "'square' has the sides 0 to 3, not 4"),
        (("solve", "thirds", *SIZES, "--side=-1"), "'square' has the sides 0 to 3, not -1"),
        (("solve", "thirds", *SIZES, "--side", "left"), "argument --side: invalid int value: 'left'"),
        (
            ("solve", "natural", *SIZES, "--mesh", "quads"),
            "argument --mesh: 'quads' is neither structured nor unstructured nor a file",
        ),
        (("solve", "natural", *SIZES, "--algorithm", "simplex"), "invalid choice: 'simplex'"),
        (("solve", "natural", *SIZES, "--max-steps", "0"), "'0' must be a whole number of at least 1"),
        (("solve", "natural", *SIZES, "--max-steps", "1.5"), "'1.5' must be a whole number of at least 1"),
    ],
)
def test_bad_arguments(capsys, arguments, message):
    assert message in refused(capsys, *arguments)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (DECLARATION.replace("title", "titel").encode(), "there is no field 'titel' here"),
        (DECLARATION.replace("2 }]", "}]").encode(), "u[0]"),
        (DECLARATION.replace("formula: ", "formula: -").encode(), "lambda = du/dn < 0"),
        (b"\x00\xff\xfe\x80", "is not a YAML file"),
        (b"a: [1, 2", "is not a YAML file"),
        (b"", "has no fields; a problem has polygon, f and g"),
        (b"f: !!int x", "own.yaml: 'tag:yaml.org,2002:int' in line 1 is a tag; write the value alone"),
        (b"a: &a [*a, *a]", "own.yaml: 'a' in line 1 is an anchor or alias; write the value itself"),
        (
            f"constants: {{ 1: 2 }}\n{DECLARATION}".encode(),
            "field constants: '1' cannot be a constant's name",
        ),
        (SQUARE.replace("f: 1", f"f: {'9' * 5000}").encode(), "field f: the formula has more than 2000 char"),
        (SQUARE.replace("g: 0", f"g: {DEGREE}").encode(), "field g: '(((x+y)/9)**100)**100' has, multiplied"),
        (
            SQUARE.replace("g: 0", f"g: {NESTED}").encode(),
            "field g: the formula has more than 30 parentheses",
        ),
        (
            f"{SQUARE}? {'k' * 100_000}\n: 1\n".encode(),
            f"there is no field '{'k' * 57}...' here; the fields are",
        ),
        (f"{SQUARE}title: {'[1], ' * 2000}\n".encode(), "is not a YAML file"),
        (
            f"{SQUARE}title: [{'[1], ' * 2000}]\n".encode(),
            "field title: it is [[1], [1], [1], [1], [1], [1], [1], [1], [1], [1], [1], [...; it",
        ),
    ],
    ids=[
        *("typo", "formula", "not a solution", "binary", "half", "empty", "tag", "alias", "number as a name"),
        *("digits", "degree", "nested", "long name", "no list", "long list"),
    ],
)
def test_bad_files(capsys, tmp_path, content, message):
    file = tmp_path / "own.yaml"
    file.write_bytes(content)
    assert message in refused(capsys, "solve", str(file), *SIZES)


def test_a_missing_file_and_a_folder(capsys, tmp_path):
    (tmp_path / "folder.yaml").mkdir()
    for path in (tmp_path / "missing.yaml", tmp_path / "folder.yaml", tmp_path):
        assert str(path) in refused(capsys, "solve", str(path), *SIZES)


def test_the_installed_command():
    found = subprocess.run(
        [SCRIPT, "solve", "full_contact", *SIZES, "--json"], capture_output=True, text=True, timeout=60
    )
    assert (found.returncode, found.stderr) == (0, "")
    assert list(json.loads(found.stdout)) == KEYS
    bad = subprocess.run([SCRIPT, "solve", "unknown", *SIZES], capture_output=True, text=True, timeout=60)
    assert (bad.returncode, bad.stdout, bad.stderr.count("\n")) == (2, "", 1)


@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize("arguments", [("cases",), ("solve", "full_contact", *SIZES)], ids=["cases", "solve"])
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


COMMANDS = [("--help",), ("--version",), ("cases",), ("solve", "full_contact", *SIZES)]


def alone(*arguments, shell="", **environment):
    """The command in a process of its own; `shell` redirects its streams."""
    command = f"{SCRIPT} {' '.join(arguments)} {shell}"
    found = subprocess.run(
        ["sh", "-c", command], capture_output=True, env={**os.environ, **environment}, timeout=60, cwd=ROOT
    )
    return found.returncode, found.stdout, found.stderr.decode()


@pytest.mark.parametrize("arguments", COMMANDS, ids=lambda value: value[0])
@pytest.mark.parametrize(
    ("shell", "message"),
    [(">/dev/full", "No space left on device"), (">&-", "standard output is closed")],
    ids=["full", "closed"],
)
def test_output_that_cannot_be_written_is_code_4(arguments, shell, message):
    """A full disk is what writing to /dev/full gives, see full(4)."""
    found = alone(*arguments, shell=shell)
    assert found == (4, b"", f"unilateral: the system failed: {message}\n")


def test_without_a_buffer_a_full_disk_is_met_earlier():
    found = alone("cases", shell=">/dev/full", PYTHONUNBUFFERED="1")
    assert found == (4, b"", "unilateral: the system failed: No space left on device\n")


@pytest.mark.parametrize("shell", ["2>&-", "2>/dev/full"])
def test_messages_that_cannot_be_written_change_no_code(shell):
    """And do not go to standard output; the solve warns, the other one is refused."""
    assert alone("solve", "unknown", *SIZES, shell=shell)[:2] == (2, b"")
    code, out, _ = alone("solve", "natural", "--h", "1/4", "--H", "1/8", "--json", shell=shell)
    assert code == 0
    assert list(json.loads(out)) == KEYS
    assert alone("cases", shell=f"{shell} >/dev/full")[0] == 4


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
    found = subprocess.run(
        [sys.executable, "-c", source],
        capture_output=True,
        env={**os.environ, "PYTHONIOENCODING": encoding},
        timeout=60,
    )
    assert (found.returncode, found.stderr) == (0, b"")
    assert found.stdout.decode(encoding.split(":")[0]).splitlines() == [letters]


def test_a_file_s_name_that_is_no_text_is_printed(tmp_path):
    """Bytes that are not UTF-8, which Python keeps as surrogates."""
    file = os.fsencode(tmp_path) + b"/\xff.yaml"
    Path(os.fsdecode(file)).write_text(SQUARE)
    found = subprocess.run([SCRIPT, "solve", file, *SIZES], capture_output=True, timeout=60)
    assert (found.returncode, found.stderr) == (0, b"")
    assert found.stdout.startswith(rb"\udcff: h = ")


def test_the_entry_point_imports_next_to_nothing():
    """So that `main` is there to be interrupted; control: --help, which knows all options, imports more."""
    source = "import sys, unilateral.cli; {} print({{'numpy', 'sympy', 'argparse'}} & set(sys.modules))"
    assert in_a_process(source.format("")).endswith("set()\n")
    assert "numpy" in in_a_process(source.format("unilateral.cli.main(['--version']);"))


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
    code, out, err = alone("cases", PYTHONPATH=str(tmp_path))
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
def test_a_failure_in_the_midst_is_code_4(capsys, monkeypatch, error, message):
    """And not 1, a claim that fails; control: that one."""

    def failing(*_):
        raise error

    monkeypatch.setattr(claims, "load", failing)
    code, out, err = run(capsys, "claims", "4.12")
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert message in err
    monkeypatch.undo()
    monkeypatch.setattr(claims.Judgement, "holds", False)
    assert run(capsys, "claims", "4.12")[0] == 1


def test_a_failure_in_code_without_a_file_is_told(capsys, monkeypatch):
    """As numpy functions are that sympy makes: their place has no module's name."""
    source = "def failing(*_):\n    raise ArithmeticError('no number')\n"
    made = {"__builtins__": __builtins__}
    exec(compile(source, "<lambdifygenerated-1>", "exec"), made)
    del made["__builtins__"]
    monkeypatch.setattr(claims, "load", made["failing"])
    code, _, err = run(capsys, "claims", "4.12")
    assert (code, err.count("\n")) == (4, 1)
    assert err.endswith("ArithmeticError: no number (<lambdifygenerated-1>, line 2)\n")


@pytest.mark.parametrize("command", [(), ("cases",), ("claims",), ("solve",)], ids=str)
def test_help_lists_the_exit_codes(capsys, command):
    """Those of the docstring."""
    code, out, err = run(capsys, *command, "--help")
    assert (code, err) == (0, "")
    codes = " ".join(cli.__doc__.split()).split("Exit codes: ")[1].split(". ")[0]
    assert f"exit codes: {codes}" in " ".join(out.split())


def test_gmsh_is_imported_only_where_a_mesh_is_made_by_it():
    """At H = h lambda is not judged, so that a structured mesh is all there is."""
    source = "import sys; from unilateral.cli import main; {}; print('gmsh' in sys.modules)"
    solve = "main(['solve', 'natural', '--h', '1/8', '--H', '{}'])"
    assert in_a_process(source.format("main(['cases'])")).endswith("False\n")
    assert in_a_process(source.format(solve.format("1/8"))).endswith("False\n")
    assert in_a_process(source.format(solve.format("1/4"))).endswith("True\n")


def test_warnings_are_as_before_afterwards(capsys):
    before = warnings.showwarning
    run(capsys, "solve", "unknown", *SIZES)
    assert warnings.showwarning is before
