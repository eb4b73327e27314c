"""`solve` on given sizes: what it prints and keeps, and with which exit code."""

import json
import re

import numpy as np
import pytest
from conftest import ROOT, discrete, exact_errors, load
from typed import FINER, KEYS, OWN_CASE, PROBLEM, SIZES, solve_json

from unilateral.bounds.enclosed_data import enclose_data
from unilateral.bounds.local_bounds import local_bound
from unilateral.discrete import condensed
from unilateral.fem.form import H1
from unilateral.formulas.decimals import format_down, format_interval, format_up
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.fortin import beta_lower_bound
from unilateral.system.files import format_file_size

NOT_UNIQUE = (
    "unilateral: lambda_H may not be unique, because beta is 0 up to rounding; take h < H, such as H = 2h\n"
)
pytestmark = pytest.mark.usefixtures("shared_cases")


def test_solve_prints_a_table(run):
    code, out, err = run("solve", "natural", *FINER)
    assert (code, err) == (0, "")
    assert out.startswith("natural: h = 0.0625, H = 0.125, h/H = 0.5\n")
    alone = discrete("natural", 16, 8)
    solution = condensed.solve_condensed_problem(alone)
    errors = exact_errors(alone, solution)
    assert (
        f"uzawa converged             algebraic error at most {format_up(solution.result.bound, '.4e')}"
        in out
    )
    assert f"after {solution.result.iterations} steps" in out
    for name, sign, value in (("u - u_h||_1", "=", "h1"), ("lambda - lambda_H||_0", "=", "l2")):
        assert re.search(rf"\|\|{re.escape(name)} +{sign} {getattr(errors, value):.4e}\n", out), name
    lower, upper = map(float, re.search(r"lambda_H\|\|_-1/2 +>= (\S+), <= (\S+)\n", out).groups())
    assert errors.hm12_discrete <= lower * (1 + 1e-4)
    assert lower < upper <= 1.05 * lower


def test_json_has_the_library_s_numbers(run):
    """natural at h = 1/16: the total bound is at least the error, and at most 30 % more."""
    code, found, err = solve_json(run, "natural", *FINER)
    assert (code, err) == (0, "")
    alone = discrete("natural", 16, 8)
    of = load("natural")
    solution = condensed.solve_condensed_problem(alone)
    errors = exact_errors(alone, solution)
    lower, upper = build_dual_norm(alone.spaces.partition, [of]).bound_error(of, solution.lambda_H[None])
    mesh = alone.exact.ritz.condensed.mesh
    data = enclose_data(of.problem, mesh, H1)
    bound = local_bound(data, alone.spaces.partition, solution.u_h, solution.lambda_H, H1)
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
        "beta": beta_lower_bound(mesh, alone.spaces.partition),
        "hm12_algebraic_bound": solution.result.bound / beta_lower_bound(mesh, alone.spaces.partition),
        "norm": "h1",
        "total_bound": bound.u,
        "h1_error": errors.h1,
        "l2_error": errors.l2,
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
    dual, l2 = (line for line in out.splitlines() if line.startswith("  ||lambda - lambda_H"))
    assert ">= " in dual
    assert "<=" not in dual
    assert l2.endswith("= undefined, because lambda is not in L2")
    assert "because beta" not in out


def test_the_algebraic_error_of_lambda_is_told_by_the_bound_on_beta(run):
    """On an adapted mesh, too: by hand, and as it is printed."""
    for how in (SIZES, ("--accuracy", "1e-1", "--max-unknowns", "5000")):
        found = solve_json(run, "thirds", *how)[1]
        assert 0.2 < found["beta"] < 0.8
        assert found["hm12_algebraic_bound"] == found["algebraic_bound"] / found["beta"]
        out = run("solve", "thirds", *how)[1]
        told = f"at most {format_up(found['hm12_algebraic_bound'], '.4e')} in H^(-1/2), guaranteed"
        assert (
            f"  that of lambda_H            {told}, as beta >= {format_down(found['beta'], '.3f')}\n" in out
        )


def test_where_beta_is_0_the_multiplier_is_not_judged(run):
    """At H = h; the active set, which ran, counts no steps."""
    code, found, err = solve_json(run, "natural", "--h", "1/8", "--H", "1/8")
    assert (code, err) == (0, NOT_UNIQUE)
    of_lambda = ["hm12_algebraic_bound", "hm12_error_lower", "hm12_error_upper", "l2_error"]
    assert found["beta"] == 0
    assert [key for key in KEYS if found[key] is None] == ["goal", "ended", "reach", "iterations", *of_lambda]
    alone = discrete("natural", 8, 8)
    assert found["h1_error"] == pytest.approx(
        exact_errors(alone, condensed.solve_condensed_problem(alone)).h1, rel=1e-9
    )
    _, out, _ = run("solve", "natural", "--h", "1/8", "--H", "1/8")
    assert out.count("not judged, because beta is 0 up to rounding") == 2
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


def test_the_lshape_and_a_side(run):
    found = [solve_json(run, "thirds", *SIZES, "--polygon", "lshape", "--side", side)[1] for side in "02"]
    assert [each["unknowns"] for each in found] == [3 * 64 + 4 * 8 + 1] * 2
    assert [each["multipliers"] for each in found] == [32] * 2
    assert found[0]["h1_error"] != found[1]["h1_error"]


def test_an_unstructured_mesh(run):
    code, found, _ = solve_json(run, "natural", *SIZES, "--mesh", "unstructured")
    assert code == 0
    assert found["h"] == pytest.approx(1 / 8, rel=1e-12)
    assert found["unknowns"] != 81


def test_a_case_of_one_s_own(run, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text(OWN_CASE)
    code, found, err = solve_json(run, str(file), *SIZES)
    assert (code, err, found["problem"]) == (0, "", "own")


@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov"])
def test_too_few_steps_end_with_code_3_and_a_message(run, algorithm):
    options = ("natural", *SIZES, "--max-steps", "1", "--algorithm", algorithm)
    code, found, err = solve_json(run, *options)
    assert (code, found["converged"], found["iterations"]) == (3, False, 1)
    bound = format_up(found["algebraic_bound"], ".4e")
    assert err == (
        f"unilateral: the iteration did not converge: the algebraic error is at most {bound} after 1 step; "
        "allow more of them, or take another algorithm\n"
    )
    code, out, _ = run("solve", *options)
    assert code == 3
    assert f"{algorithm} NOT converged" in out


def test_rho_and_tolerance_are_obeyed(run):
    options = (("1e-2", "--rho", "1/4"), ("1e-8", "--rho", "1/4"), ("1e-8",))
    loose, tight, default = (solve_json(run, "natural", *SIZES, "--tolerance", *each)[1] for each in options)
    assert tight["algebraic_bound"] <= 1e-8 < loose["algebraic_bound"] <= 1e-2
    assert loose["iterations"] < tight["iterations"]
    assert default["iterations"] < tight["iterations"]


def test_given_sizes_of_a_problem(run):
    code, found, err = solve_json(run, PROBLEM, *SIZES)
    assert (code, err) == (0, "")
    assert found["h"] <= 1 / 8 < found["h"] * 2
    assert found["algebraic_bound"] <= 0.01 * found["total_bound"]
    _, out, _ = run("solve", PROBLEM, *SIZES)
    assert f"guaranteed                  ||u - u_h||_1 <= {format_up(found['total_bound'], '.4e')}" in out
    assert "lambda_H||_0" not in out


def test_relative_bounds_are_printed_where_the_size_is_known(run):
    """As in JSON, and the size times the relative bound is the bound. lambda of no_contact is 0."""
    _, found, _ = solve_json(run, "natural", *FINER)
    _, out, _ = run("solve", "natural", *FINER)
    for error, of, norm in (("u - u_h||_1", "u", "h1"), ("lambda - lambda_H||_-1/2", "lambda", "hm12")):
        error, of = map(re.escape, (f"||{error}", f"||{of}||_{'1' if norm == 'h1' else '-1/2'}"))
        ((bound, share, size),) = re.findall(rf"{error} <= (\S+) <= (\S+) {of}, {of} >= (\S+)\n", out)
        assert share == format_up(found[f"{norm}_relative_bound"], ".3g")
        assert float(share) * float(size) == pytest.approx(float(bound), rel=0.01)
    _, out, _ = run("solve", "no_contact", *FINER)
    assert re.search(r"\|\|lambda - lambda_H\|\|_-1/2 <= \S+\n", out)


KEPT = {"solution.vtu", "boundary.csv", "solution.nc", "certificate.json", "solution.svg"}


def test_a_solution_is_kept(run, tmp_path):
    """All files of a folder, which is made, and others by their endings; the certificate is what is told."""
    folder = tmp_path / "new/out"
    extra = [tmp_path / name for name in ("a.csv", "b.png")]
    named = [part for file in extra for part in ("-o", str(file))]
    code, found, err = solve_json(run, "natural", *SIZES, "--out", str(folder), *named)
    assert (code, err) == (0, "")
    assert {file.name for file in folder.iterdir()} == KEPT
    assert {file.name for file in tmp_path.iterdir()} == {"new", "a.csv", "b.png"}
    assert json.loads((folder / "certificate.json").read_text()) == found
    assert (folder / "boundary.csv").read_bytes() == extra[0].read_bytes()


def test_every_file_that_is_kept_is_told_with_its_size(run, tmp_path):
    """Not with --json, where one object is printed and nothing else: see above."""
    files = [tmp_path / name for name in ("a.csv", "a.vtu")]
    code, out, err = run("solve", "natural", *SIZES, *(part for file in files for part in ("-o", file)))
    assert (code, err) == (0, "")
    lines = [f"  written                     {file}, {format_file_size(file)}" for file in files]
    assert out.splitlines()[-2:] == lines
    assert "written" not in run("solve", "natural", *SIZES)[1]


@pytest.mark.parametrize(
    ("size", "shown"), [(0, "0 B"), (999, "999 B"), (1000, "1 kB"), (12345, "12.3 kB"), (999_600, "1 MB")]
)
def test_sizes_have_three_digits(tmp_path, size, shown):
    (tmp_path / "one").write_bytes(bytes(size // 2))
    (tmp_path / "two").write_bytes(bytes(size - size // 2))
    assert format_file_size(tmp_path / "one", tmp_path / "two") == shown


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("-o", "x.abc"), "x.abc: the ending must be .vtu, .csv, .nc, .json, .svg, .png, .pdf or .html"),
        (("-o", "none/x.vtu"), "none/x.vtu cannot be written: there is no folder none"),
        (("-o", "folder.vtu"), "folder.vtu cannot be written: it is a folder"),
        (("--out", "file/new"), "file/new cannot be written: Not a directory"),
        (("--dry-run", "--out", "new"), "--dry-run computes no solution that could be written"),
    ],
)
def test_what_cannot_be_kept_is_told_before_the_solve(refused, tmp_path, monkeypatch, options, message):
    """Nothing is solved, or it would fail."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("unilateral.cli.solve.api.solve", None)
    (tmp_path / "file").touch()
    (tmp_path / "folder.vtu").mkdir()
    sizes = ("--accuracy", "0.1") if "--dry-run" in options else SIZES
    assert f": {message}" in refused("solve", "natural", *sizes, *options)
    assert {file.name for file in tmp_path.iterdir()} == {"file", "folder.vtu"}


def test_the_contact_is_printed(run, monkeypatch):
    """natural: on half of side 0, up to a cell, and on all others; full_contact: everywhere."""
    rows = dict(re.findall(r"^  (contact\S*(?: side .)?) +(.*)$", run("solve", "natural", *FINER)[1], re.M))
    certain, computed = rows["contact, side 0"].split("; computed: ")
    start, end = map(float, re.match(r"(\S+) to (\S+),", computed).groups())
    assert (start, end) == (pytest.approx(0.5, abs=1 / 8), 1)
    assert rows["contact"] == f"length {4 - start:g}, computed"
    # what is certain comes first
    assert re.fullmatch(r"(touches within|not decided on) .*", certain)
    assert all(
        rows[f"contact, side {side}"].endswith("; computed: 0 to 1, length 1")
        and rows[f"contact, side {side}"].startswith("touches within ")
        for side in (1, 2, 3)
    )
    out = run("solve", "full_contact", *SIZES)[1]
    assert "  contact                     the whole boundary, length 4, computed\n" in out
    out = run("solve", "no_contact", *SIZES)[1]
    assert "  contact                     none, computed\n" in out
    assert "computed: " not in out
    monkeypatch.setattr("unilateral.cli.report.MAX_FORCE_SIDES", 3)
    assert "contact, side" not in run("solve", "natural", *SIZES)[1]


def test_the_forces_are_printed(run, monkeypatch):
    """The integral of natural's lambda is 16, by quadrature of its polynomial; free sides have none."""
    _, found, _ = solve_json(run, "natural", *FINER, "--sharp")
    assert list(found["forces"]) == ["boundary", "side_0", "side_1", "side_2", "side_3"]
    whole = found["forces"]["boundary"]
    assert 15.9 < whole["lower"] <= 16 <= whole["upper"] < 16.1
    _, out, _ = run("solve", "natural", *FINER, "--sharp")
    of = found["forces"]["side_2"]
    assert of["known"] == "both"
    numbers = format_interval(of["lower"], of["upper"], of["value"], ".4e")
    assert re.fullmatch(r"\S+, between \S+ and \S+", numbers)
    assert f"  force, side 2               {numbers}\n" in out
    _, found, _ = solve_json(run, "thirds", *FINER, "--free-sides", "1,3")
    assert list(found["forces"]) == ["boundary", "side_0", "side_2"]
    monkeypatch.setattr("unilateral.cli.solve.MAX_FORCE_SIDES", 3)
    _, found, _ = solve_json(run, "natural", *FINER)
    assert found["forces"] is None


def test_free_sides_of_a_case_change_no_solution_but_the_count(run):
    """thirds has contact on side 0; its lambda_H is 0 on the others anyway."""
    sizes = ("thirds", *SIZES, "--tolerance", "1e-9")
    (_, held, _), (_, free, _) = (solve_json(run, *sizes, *of) for of in ((), ("--free-sides", "2,3")))
    assert (held["multipliers"], free["multipliers"]) == (16, 8)
    assert free["h1_error"] == pytest.approx(held["h1_error"], abs=3e-9)
    assert free["l2_error"] == pytest.approx(held["l2_error"], rel=1e-5)
    assert free["total_bound"] >= free["h1_error"]


def test_idle_sides_are_left_out_on_request(run, problem_file_of):
    """f >= 1 and g < 1 on sides 0 and 3: 8 of 16 multipliers."""
    file = problem_file_of(f="1 + x*y", g="[x**2/2, 1/2 + y, x + 1/2, y/2]")
    (_, every, _), (_, left_out, _) = (
        solve_json(run, file, *SIZES, *of) for of in ((), ("--leave-out-idle-sides",))
    )
    assert (every["multipliers"], left_out["multipliers"]) == (16, 8)
    assert left_out["total_bound"] == pytest.approx(every["total_bound"], rel=1e-2)


def test_a_bound_that_does_not_fit_into_the_memory_is_left_out(run, monkeypatch):
    """1089 unknowns take 1 MB, and by the sharp bound 5; control: the cheap one."""
    monkeypatch.setattr("unilateral.solution.bounds.available_mb", lambda: 2.0)
    sizes = "--h", "1/32", "--H", "1/16"
    code, out, err = run("solve", "no_contact", *sizes, "--sharp")
    assert (code, err) == (0, "unilateral: no guaranteed bound: it takes about 5 MB, and 2 MB are free\n")
    assert "guaranteed  " not in out
    assert "guaranteed  " in run("solve", "no_contact", *sizes)[1]


LINEAR = "no side carries contact, so the problem is linear and has no multipliers"


def test_a_problem_without_contact_is_solved_and_said_to_be_linear(run, tmp_path):
    """The norm is named as c = 0 has it, and rows that would say nothing are left out."""
    file = linear(tmp_path)
    code, out, err = run("solve", file, "--h", "1/8", "--H", "1/4")
    assert (code, err) == (0, "")
    assert LINEAR in out
    assert "k^(1/2) |u - u_h|_1 <= " in out
    assert "reaction, sides 1, 2, 3" in out
    assert "||u" not in out
    assert "lambda" not in out
    assert LINEAR in run("check", file)[1]


def linear(folder, rest="free_sides: [0], u: {1: 0, 2: 0, 3: null}, k: 2, c: 0", g="null"):
    file = folder / "linear.yaml"
    square = "polygon: [[0, 0], [1, 0], [1, 1], [0, 1]], f: 1"
    none = f"g: [{g}, null, null, null]"
    file.write_text(f"{{{square}, {none}, {rest}}}")
    return str(file)


@pytest.mark.parametrize("rest", ["u: {1: 0}, free_sides: [0, 2, 3], c: 0", "free_sides: [0, 1, 2, 3]"])
def test_what_only_multipliers_have_is_null_where_there_are_none(run, tmp_path, rest):
    """Control: with an obstacle, which is far away, numbers are there, among them forces of 0."""
    sizes = "--h", "1/8", "--H", "1/4", "--json"
    names = "beta", "hm12_algebraic_bound", "hm12_bound"
    found = json.loads(run("solve", linear(tmp_path, rest), *sizes)[1])
    assert [found[name] for name in names] == [None] * 3
    assert [*(found["forces"] or {})] == ["reaction_1"] * ("u" in rest[:2])
    found = json.loads(run("solve", linear(tmp_path, rest.replace("[0, ", "["), g="-9"), *sizes)[1])
    assert all(isinstance(found[name], float) for name in names)
    assert found["forces"]["boundary"]["value"] == found["forces"]["side_0"]["value"] == 0


def test_an_accuracy_of_multipliers_is_refused_where_there_are_none(run, tmp_path):
    """Control: one of u is reached."""
    asked = "solve", linear(tmp_path), "--accuracy", "0.5"
    said = f"unilateral: 'linear': {LINEAR}; ask for an accuracy of u, in the norm h1\n"
    for more in ((), ("--absolute",), ("--dry-run",)):
        assert run(*asked, "--norm", "hm12", *more) == (2, "", said)
    assert "  certified: k^(1/2) |u - u_h|_1 <= " in run(*asked)[1]


def test_errors_of_multipliers_are_not_printed_where_there_are_none(run, tmp_path):
    """Of a case whose sides are clamped and free; control: on its free side there may be multipliers."""
    file = tmp_path / "own.yaml"
    given = (ROOT / "manufactured/clamped.yaml").read_text()
    start, _, rest = given.partition("  - { atom: tensor")
    rest = rest.partition("\n")[2].partition("gap:")[0] + "gap: { sides: [], elsewhere: 1 }\nclamped:"
    sides = "".join(f"\n  - {{ side: {i}, u: cos(pi*x)*y**2/2 }}" for i in (1, 2, 3))
    file.write_text(start + rest + sides + "\nc: 0" + given.partition("\nc: 0")[2])
    case = "solve", str(file), "--h", "1/8", "--H", "1/4"
    assert "||lambda - lambda_H||_-1/2  >= " in run(*case)[1]
    out = run(*case, "--free-sides", "0")[1]
    assert re.search(r"\|u - u_h\|_1 += ", out)
    assert "lambda" not in out


def test_where_the_bound_is_as_large_as_u_an_accuracy_is_offered_and_is_reached(run, problem_file_of):
    """Two vertices are 1e-6 apart, so that triangles are flat, which is told too.

    Controls: without one of them, and where u is 0, nothing is said.
    """
    near = "[[0, 0], [1, 0], [1, 1], [0.500001, 1.000001], [0.5, 1], [0, 1]]"
    file = problem_file_of(polygon=near, f="-1 - x", g="-x/10")
    code, out, told = run("solve", file, *SIZES)
    assert code == 0
    assert re.fullmatch("unilateral: most of the bound on the error comes from triangles .*\n", told)
    assert "does not rule out an error as large as u itself" in out
    (offered,) = re.findall(r"(--accuracy \S+) in place of --h and --H", out)
    code, out, told = run("solve", file, *offered.split())
    assert (code, told) == (0, "")
    assert "  certified: " in out
    for fields in ({"f": "-1 - x", "g": "-x/10"}, {"f": "0", "g": "-1"}):
        assert "hint" not in run("solve", problem_file_of(**fields), *SIZES)[1]
