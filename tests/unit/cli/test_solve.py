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
    single_discrete = discrete("natural", 16, 8)
    solution = condensed.solve_condensed_problem(single_discrete)
    errors = exact_errors(single_discrete, solution)
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
    code, records, err = solve_json(run, "natural", *FINER)
    assert (code, err) == (0, "")
    single_discrete = discrete("natural", 16, 8)
    table = load("natural")
    solution = condensed.solve_condensed_problem(single_discrete)
    errors = exact_errors(single_discrete, solution)
    lower, upper = build_dual_norm(single_discrete.spaces.partition, [table]).bound_error(
        table, solution.lambda_H[None]
    )
    mesh = single_discrete.exact.ritz.condensed.mesh
    data = enclose_data(table.problem, mesh, H1)
    bound = local_bound(data, single_discrete.spaces.partition, solution.u_h, solution.lambda_H, H1)
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
        "beta": beta_lower_bound(mesh, single_discrete.spaces.partition),
        "hm12_algebraic_bound": solution.result.bound
        / beta_lower_bound(mesh, single_discrete.spaces.partition),
        "norm": "h1",
        "total_bound": bound.u,
        "h1_error": errors.h1,
        "l2_error": errors.l2,
        "hm12_error_lower": lower[0],
        "hm12_error_upper": upper[0],
    }
    for key, value in expected.items():
        assert records[key] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), key
    assert records["h1_error"] <= records["total_bound"] <= 1.3 * records["h1_error"]
    assert {name.split("_")[0] for name in KEYS if re.search("_error|_bound", name)} >= set(records["norms"])
    assert records["seconds"] > 0
    assert records["peak_mb"] > 1


def test_a_multiplier_outside_L2_has_a_lower_bound_and_no_other_number(run):
    """And beta is not what is to blame."""
    code, out, err = run("solve", "rough", *SIZES)
    assert (code, err) == (0, "")
    dual, l2 = [line for line in out.splitlines() if line.startswith("  ||lambda - lambda_H")]
    assert ">= " in dual
    assert "<=" not in dual
    assert l2.endswith("= undefined, because lambda is not in L2")
    assert "because beta" not in out


def test_the_algebraic_error_of_lambda_is_told_by_the_bound_on_beta(run):
    """On an adapted mesh, too: by hand, and as it is printed."""
    for how in (SIZES, ("--accuracy", "1e-1", "--max-unknowns", "5000")):
        record = solve_json(run, "thirds", *how)[1]
        assert 0.2 < record["beta"] < 0.8
        assert record["hm12_algebraic_bound"] == record["algebraic_bound"] / record["beta"]
        out = run("solve", "thirds", *how)[1]
        text = f"at most {format_up(record['hm12_algebraic_bound'], '.4e')} in H^(-1/2), guaranteed"
        assert (
            f"  that of lambda_H            {text}, as beta >= {format_down(record['beta'], '.3f')}\n" in out
        )


def test_where_beta_is_0_the_multiplier_is_not_judged(run):
    """At H = h; the active set, which ran, counts no steps."""
    code, records, err = solve_json(run, "natural", "--h", "1/8", "--H", "1/8")
    assert (code, err) == (0, NOT_UNIQUE)
    lambda_fields = ["hm12_algebraic_bound", "hm12_error_lower", "hm12_error_upper", "l2_error"]
    assert records["beta"] == 0
    assert [key for key in KEYS if records[key] is None] == [
        "goal",
        "ended",
        "reach",
        "iterations",
        *lambda_fields,
    ]
    single_discrete = discrete("natural", 8, 8)
    assert records["h1_error"] == pytest.approx(
        exact_errors(single_discrete, condensed.solve_condensed_problem(single_discrete)).h1, rel=1e-9
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


def test_a_case_is_solved_on_the_lshape_at_the_chosen_side(run):
    """By counting: three squares of 8^2 nodes and those on the other sides; cells of 1/4 on a length of 8."""
    records = [solve_json(run, "thirds", *SIZES, "--polygon", "lshape", "--side", side)[1] for side in "02"]
    assert [record["unknowns"] for record in records] == [3 * 64 + 4 * 8 + 1] * 2
    assert [record["multipliers"] for record in records] == [32] * 2
    assert records[0]["h1_error"] != records[1]["h1_error"]


def test_an_unstructured_mesh_has_the_size_asked_for(run):
    code, records, _ = solve_json(run, "natural", *SIZES, "--mesh", "unstructured")
    assert code == 0
    assert records["h"] == pytest.approx(1 / 8, rel=1e-12)
    assert records["unknowns"] != 81


def test_a_case_of_one_s_own_is_solved_under_its_name(run, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text(OWN_CASE)
    code, records, err = solve_json(run, str(file), *SIZES)
    assert (code, err, records["problem"]) == (0, "", "own")


@pytest.mark.parametrize("algorithm", ["uzawa", "nesterov"])
def test_too_few_steps_end_with_code_3_and_a_message(run, algorithm):
    options = ["natural", *SIZES, "--max-steps", "1", "--algorithm", algorithm]
    code, records, err = solve_json(run, *options)
    assert (code, records["converged"], records["iterations"]) == (3, False, 1)
    bound = format_up(records["algebraic_bound"], ".4e")
    assert err == (
        f"unilateral: the iteration did not converge: the algebraic error is at most {bound} after 1 step; "
        "allow more steps, or take another algorithm\n"
    )
    code, out, _ = run("solve", *options)
    assert code == 3
    assert f"{algorithm} NOT converged" in out


def test_rho_and_tolerance_are_obeyed(run):
    _, loose, _ = solve_json(run, "natural", *SIZES, "--tolerance", "1e-2", "--rho", "1/4")
    _, tight, _ = solve_json(run, "natural", *SIZES, "--tolerance", "1e-8", "--rho", "1/4")
    _, default, _ = solve_json(run, "natural", *SIZES, "--tolerance", "1e-8")
    assert tight["algebraic_bound"] <= 1e-8 < loose["algebraic_bound"] <= 1e-2
    assert loose["iterations"] < tight["iterations"]
    assert default["iterations"] < tight["iterations"]


def test_the_sizes_given_for_a_problem_are_those_of_its_mesh(run):
    code, records, err = solve_json(run, PROBLEM, *SIZES)
    assert (code, err) == (0, "")
    assert records["h"] <= 1 / 8 < records["h"] * 2
    assert records["algebraic_bound"] <= 0.01 * records["total_bound"]
    _, out, _ = run("solve", PROBLEM, *SIZES)
    assert f"guaranteed                  ||u - u_h||_1 <= {format_up(records['total_bound'], '.4e')}" in out
    assert "lambda_H||_0" not in out


def test_relative_bounds_are_printed_where_the_size_is_known(run):
    """As in JSON, and the size times the relative bound is the bound. lambda of no_contact is 0."""
    _, records, _ = solve_json(run, "natural", *FINER)
    _, out, _ = run("solve", "natural", *FINER)
    for error, variable, norm in (("u - u_h||_1", "u", "h1"), ("lambda - lambda_H||_-1/2", "lambda", "hm12")):
        error, variable = map(re.escape, (f"||{error}", f"||{variable}||_{'1' if norm == 'h1' else '-1/2'}"))
        ((bound, share, size),) = re.findall(
            rf"{error} <= (\S+) <= (\S+) {variable}, {variable} >= (\S+)\n", out
        )
        assert share == format_up(records[f"{norm}_relative_bound"], ".3g")
        assert float(share) * float(size) == pytest.approx(float(bound), rel=0.01)
    _, out, _ = run("solve", "no_contact", *FINER)
    assert re.search(r"\|\|lambda - lambda_H\|\|_-1/2 <= \S+\n", out)


KEPT = {"solution.vtu", "boundary.csv", "solution.nc", "certificate.json", "solution.svg"}


def test_a_solution_is_kept(run, tmp_path):
    """All files of a folder, which is made, and others by their endings; the certificate is what is told."""
    folder = tmp_path / "new/out"
    extra = [tmp_path / name for name in ("a.csv", "b.png")]
    named = [component for file in extra for component in ("-o", str(file))]
    code, records, err = solve_json(run, "natural", *SIZES, "--out", str(folder), *named)
    assert (code, err) == (0, "")
    assert {file.name for file in folder.iterdir()} == KEPT
    assert {file.name for file in tmp_path.iterdir()} == {"new", "a.csv", "b.png"}
    assert json.loads((folder / "certificate.json").read_text()) == records
    assert (folder / "boundary.csv").read_bytes() == extra[0].read_bytes()


def test_every_file_that_is_kept_is_told_with_its_size(run, tmp_path):
    """Not with --json, where one object is printed and nothing else: see above."""
    files = [tmp_path / name for name in ("a.csv", "a.vtu")]
    code, out, err = run(
        "solve", "natural", *SIZES, *(component for file in files for component in ("-o", file))
    )
    assert (code, err) == (0, "")
    lines = [f"  written                     {file}, {format_file_size(file)}" for file in files]
    assert out.splitlines()[-2:] == lines
    assert "written" not in run("solve", "natural", *SIZES)[1]


@pytest.mark.parametrize(
    ("size", "displayed"), [(0, "0 B"), (999, "999 B"), (1000, "1 kB"), (12345, "12.3 kB"), (999_600, "1 MB")]
)
def test_sizes_have_three_digits(tmp_path, size, displayed):
    (tmp_path / "one").write_bytes(bytes(size // 2))
    (tmp_path / "two").write_bytes(bytes(size - size // 2))
    assert format_file_size(tmp_path / "one", tmp_path / "two") == displayed


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
def test_what_cannot_be_kept_is_told_before_the_solve(refusal, tmp_path, monkeypatch, options, message):
    """Nothing is solved, or it would fail."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("unilateral.cli.solve.api.solve", None)
    (tmp_path / "file").touch()
    (tmp_path / "folder.vtu").mkdir()
    sizes = ("--accuracy", "0.1") if "--dry-run" in options else SIZES
    assert f": {message}" in refusal("solve", "natural", *sizes, *options)
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


@pytest.mark.parametrize("options", [SIZES, ("--accuracy", "0.2")])
def test_forces_are_printed_first_then_contact_then_errors(run, options):
    """Below the levels or the head; the sizes and the algorithm follow the errors."""
    printed = run("solve", "natural", *options)[1]
    names = ["force, boundary", "force, side 3", "contact  ", "contact, side 0", "guaranteed  "]
    names += ["also guaranteed", "||u - u_h||_1   ", "unknowns  ", "converged  ", "time and memory"]
    places = [printed.index(name) for name in names]
    assert places == sorted(places)


def test_the_forces_are_printed(run, monkeypatch):
    """The integral of natural's lambda is 16, by quadrature of its polynomial; free sides have none."""
    _, records, _ = solve_json(run, "natural", *FINER, "--sharp")
    assert list(records["forces"]) == ["boundary", "side_0", "side_1", "side_2", "side_3"]
    full_boundary = records["forces"]["boundary"]
    assert 15.9 < full_boundary["lower"] <= 16 <= full_boundary["upper"] < 16.1
    _, out, _ = run("solve", "natural", *FINER, "--sharp")
    force = records["forces"]["side_2"]
    assert force["known"] == "both"
    numbers = format_interval(force["lower"], force["upper"], force["value"], ".4e")
    assert re.fullmatch(r"\S+, between \S+ and \S+", numbers)
    assert f"  force, side 2               {numbers}\n" in out
    _, records, _ = solve_json(run, "thirds", *FINER, "--free-sides", "1,3")
    assert list(records["forces"]) == ["boundary", "side_0", "side_2"]
    monkeypatch.setattr("unilateral.cli.solve.MAX_FORCE_SIDES", 3)
    _, records, _ = solve_json(run, "natural", *FINER)
    assert records["forces"] is None


def test_free_sides_of_a_case_change_no_solution_but_the_count(run):
    """thirds has contact on side 0; its lambda_H is 0 on the others anyway."""
    _, contact, _ = solve_json(run, "thirds", *SIZES, "--tolerance", "1e-9")
    _, free, _ = solve_json(run, "thirds", *SIZES, "--tolerance", "1e-9", "--free-sides", "2,3")
    assert (contact["multipliers"], free["multipliers"]) == (16, 8)
    assert free["h1_error"] == pytest.approx(contact["h1_error"], abs=3e-9)
    assert free["l2_error"] == pytest.approx(contact["l2_error"], rel=1e-5)
    assert free["total_bound"] >= free["h1_error"]


def test_idle_sides_are_left_out_on_request(run, problem_file_of):
    """f >= 1 and g < 1 on sides 0 and 3: 8 of 16 multipliers."""
    file = problem_file_of(f="1 + x*y", g="[x**2/2, 1/2 + y, x + 1/2, y/2]")
    _, every, _ = solve_json(run, file, *SIZES)
    _, left_out, _ = solve_json(run, file, *SIZES, "--leave-out-idle-sides")
    assert (every["multipliers"], left_out["multipliers"]) == (16, 8)
    assert left_out["total_bound"] == pytest.approx(every["total_bound"], rel=1e-2)


def test_a_bound_that_does_not_fit_into_the_memory_is_left_out(run, monkeypatch):
    """4225 unknowns take 1 MB, and by the sharp bound 6; control: the cheap one."""
    monkeypatch.setattr("unilateral.solution.bounds.available_mb", lambda: 2.0)
    sizes = ["--h", "1/64", "--H", "1/32"]
    code, out, err = run("solve", "no_contact", *sizes, "--sharp")
    assert (code, err) == (0, "unilateral: no guaranteed bound: it takes about 6 MB, and 2 MB are free\n")
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


def linear(folder, remaining="free_sides: [0], u: {1: 0, 2: 0, 3: null}, k: 2, c: 0", g="null"):
    file = folder / "linear.yaml"
    square = "polygon: [[0, 0], [1, 0], [1, 1], [0, 1]], f: 1"
    none = f"g: [{g}, null, null, null]"
    file.write_text(f"{{{square}, {none}, {remaining}}}")
    return str(file)


@pytest.mark.parametrize("remaining", ["u: {1: 0}, free_sides: [0, 2, 3], c: 0", "free_sides: [0, 1, 2, 3]"])
def test_what_only_multipliers_have_is_null_where_there_are_none(run, tmp_path, remaining):
    """Control: with an obstacle, which is far away, numbers are there, among them forces of 0."""
    sizes = ["--h", "1/8", "--H", "1/4", "--json"]
    names = "beta", "hm12_algebraic_bound", "hm12_bound"
    document = json.loads(run("solve", linear(tmp_path, remaining), *sizes)[1])
    assert [document[name] for name in names] == [None] * 3
    assert [*(document["forces"] or {})] == ["reaction_1"] * ("u" in remaining[:2])
    document = json.loads(run("solve", linear(tmp_path, remaining.replace("[0, ", "["), g="-9"), *sizes)[1])
    assert all(isinstance(document[name], float) for name in names)
    assert document["forces"]["boundary"]["value"] == document["forces"]["side_0"]["value"] == 0


def test_an_accuracy_of_multipliers_is_refused_where_there_are_none(run, tmp_path):
    """Control: one of u is reached."""
    arguments = ["solve", linear(tmp_path), "--accuracy", "0.5"]
    text = f"unilateral: 'linear': {LINEAR}; ask for an accuracy of u, in the norm h1\n"
    for extra in ((), ("--absolute",), ("--dry-run",)):
        assert run(*arguments, "--norm", "hm12", *extra) == (2, "", text)
    assert "  certified: k^(1/2) |u - u_h|_1 <= " in run(*arguments)[1]


def test_errors_of_multipliers_are_not_printed_where_there_are_none(run, tmp_path):
    """Of a case whose sides are clamped and free; control: on its free side there may be multipliers."""
    file = tmp_path / "own.yaml"
    text = (ROOT / "manufactured/clamped.yaml").read_text()
    start, _, remaining = text.partition("  - { atom: tensor")
    remaining = (
        remaining.partition("\n")[2].partition("gap:")[0] + "gap: { sides: [], elsewhere: 1 }\nclamped:"
    )
    sides = "".join(f"\n  - {{ side: {i}, u: cos(pi*x)*y**2/2 }}" for i in (1, 2, 3))
    file.write_text(start + remaining + sides + "\nc: 0" + text.partition("\nc: 0")[2])
    arguments = ["solve", str(file), "--h", "1/8", "--H", "1/4"]
    assert "||lambda - lambda_H||_-1/2  >= " in run(*arguments)[1]
    out = run(*arguments, "--free-sides", "0")[1]
    assert re.search(r"\|u - u_h\|_1 += ", out)
    assert "lambda" not in out


def test_where_the_bound_is_as_large_as_u_an_accuracy_is_offered_and_is_reached(run, problem_file_of):
    """Two vertices are 1e-6 apart, so that triangles are flat, which is told too.

    Controls: without one of them, and where u is 0, nothing is said.
    """
    near = "[[0, 0], [1, 0], [1, 1], [0.500001, 1.000001], [0.5, 1], [0, 1]]"
    file = problem_file_of(polygon=near, f="-1 - x", g="-x/10")
    code, out, report = run("solve", file, *SIZES)
    assert code == 0
    assert re.fullmatch("unilateral: most of the bound on the error comes from triangles .*\n", report)
    assert "allows an error as large as u itself" in out
    (offered,) = re.findall(r"(--accuracy \S+) instead of --h and --H", out)
    code, out, report = run("solve", file, *offered.split())
    assert (code, report) == (0, "")
    assert "  certified: " in out
    for fields in ({"f": "-1 - x", "g": "-x/10"}, {"f": "0", "g": "-1"}):
        assert "hint" not in run("solve", problem_file_of(**fields), *SIZES)[1]
