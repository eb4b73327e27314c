"""The benchmarks: their plan, their runner, what is summed up, and tiny runs, judged by direct quadrature."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import sentences
import xarray as xr
import yaml
from conftest import ROOT

from benchmarks import __main__ as runner
from benchmarks import plan, problem, summary
from benchmarks import ratios as judge
from benchmarks import side_by_side as benchmark_tables
from benchmarks.peers.driver import match_nodes
from study import tables
from unilateral.errors import InputError, SolutionWarning
from unilateral.geometry.polygon import find_polygon, square
from unilateral.norms.ritz import h1_distance
from unilateral.problems import case as cases
from unilateral.problems.case_certificate import certify_case

COMMITTED = ROOT / "benchmarks/benchmarks.yaml"
N = 16


def written(folder: Path, **changes: Any) -> Path:
    """The committed plan with some fields changed."""
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(COMMITTED.read_text()), **changes}), encoding="utf-8")
    return path


def small(folder: Path) -> dict[str, Any]:
    """A plan of two solvers on one problem, twice each."""
    entry = {"solvers": ["multigrid", "linear"], "problems": ["natural"], "sizes": [N], "repeats": 2}
    return plan.read(written(folder, runs=[entry]))


@pytest.mark.parametrize(
    "changes",
    [
        {"stop": 2},
        {"about": "x"},
        {"runs": [{"solvers": ["abacus"], "problems": ["natural"], "sizes": [16]}]},
        {"runs": [{"solvers": ["linear"], "problems": ["natural"], "sizes": [18]}]},
    ],
)
def test_a_plan_that_cannot_be_meant_is_refused(changes: dict[str, Any], tmp_path: Path) -> None:
    with sentences.raises(InputError):
        plan.read(written(tmp_path, **changes))


def test_the_committed_plan_compares_at_least_three_times_and_names_each_run_once() -> None:
    runs = plan.runs(plan.read(COMMITTED))
    assert len({run.name for run in runs}) == len(runs)
    assert {run.n for run in plan.runs(plan.read(COMMITTED), [256])} == {256}
    for solver in ("multigrid", "skfem", "fenicsx"):
        assert {run.repeat for run in runs if (run.solver, run.n) == (solver, 512)} >= {0, 1, 2}


def test_the_cases_hold_with_as_many_contact_zones_as_they_say() -> None:
    """Contact on the other sides is one zone each, or none."""
    zones = {}
    for name, entry in plan.read(COMMITTED)["problems"].items():
        if name == "own":  # a problem file
            continue
        case = cases.load_solution(
            ROOT / entry["case"] if entry["case"].endswith(".yaml") else entry["case"],
            find_polygon(entry["polygon"]),
        )
        zones[name] = sum(side == 0 for side, _, _ in certify_case(case).contact)
    assert (zones["natural_0437"], zones["three_zones"], zones["zones_37"]) == (1, 3, 37)


def test_a_missing_solver_is_named_with_a_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run_plan = small(tmp_path)
    assert plan.missing(run_plan, "multigrid") == ""
    run_plan["solvers"]["multigrid"]["imports"] = ["no_such_module"]
    reason = plan.missing(run_plan, "multigrid")
    assert reason == (
        f"multigrid is skipped: {sys.executable} does not have no_such_module; install it, or let "
        "UNILATERAL_BENCH_MULTIGRID name an interpreter that has it"
    )
    assert {run.solver for run in runner.available(run_plan, [])} == {"linear"}
    monkeypatch.setenv("UNILATERAL_BENCH_LINEAR", "no_such_interpreter")
    assert runner.available(run_plan, []) == []


@pytest.mark.parametrize("size", ["255", "many"])
def test_a_size_that_no_run_has_is_refused(size: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert runner.main([size]) == InputError.exit_code
    err = capsys.readouterr().err
    sizes = "32, 64, 128, 256, 512, 1024, 2048"
    assert err == f"benchmarks: there is no run of size '{size}'; sizes are {sizes}\n"


def record(cpu: float, repeat: int) -> dict[str, Any]:
    """Of a process that took so long, half of it in the operator, with another wall-clock time."""
    phases = {"assembly": [cpu / 4, 1.0], "operator": [cpu / 2, 2.0], "solve": [cpu / 4, 3.0]}
    result = {"way": "linear", "phases": phases, "iterations": 5}
    judged = {
        "reference": 2.0,
        "errors": [2.5],
        "certified": [{"bound": 3.0, "relative_bound": 0.03, "certify_cpu": 7.0}],
    }
    errors = judged if repeat == 0 else {}
    record = {"solver": "linear", "problem": "natural", "n": 16, "start": 1.0, "peak_mb": 100.0 + repeat}
    return {**record, "results": [result], **errors}


def test_a_summary_has_medians_and_the_spread() -> None:
    """By hand: 1, 2, 12 have the median 2; errors and bounds are those of the one repeat that was judged."""
    (row,) = summary.rows([record(12, 0), record(1, 1), record(2, 2)]).to_dict("records")
    assert (row["cpu_seconds"], row["cpu_least"], row["cpu_most"], row["repeats"]) == (2, 1, 12, 3)
    assert (row["assembly_cpu"], row["solve_cpu"], row["mesh_cpu"], row["wall"]) == (1.5, 0.5, 0, 6)
    assert (row["over_discrete"], row["peak_mb"], row["iterations"], row["H_over_h"]) == (1.25, 101, 5, 0)
    assert (row["relative_bound"], row["certify_cpu"]) == (0.03, 7)
    assert math.isnan(row["sets"])
    (row,) = summary.rows([record(1, 1)]).to_dict("records")
    assert math.isnan(row["relative_bound"])


def made_up() -> pd.DataFrame:
    """Seconds (n / 256)^2 of multigrid, and 4, 3, 5 and 2 times that of others; the last has no largest n."""
    times = {"multigrid": 1, "recursive newton": 4, "fenicsx": 3, "skfem": 5, "ngsolve": 2}
    rows = [
        {
            "way": way,
            "problem": "natural",
            "n": n,
            "H_over_h": judge.H_OVER_H.get(way, 2),
            "cpu_seconds": c * (n / 256) ** 2,
        }
        for way, c in times.items()
        for n in (256, 512, 1024)
        if (way, n) != ("ngsolve", 1024)
    ]
    return pd.DataFrame(rows)


def test_ratios_and_growth_are_those_of_made_up_laws() -> None:
    runs = made_up()
    assert judge.ratios(runs, "skfem").to_dict() == {256: 5, 512: 5, 1024: 5}
    assert judge.growth(judge.along(runs, "multigrid")["cpu_seconds"]) == pytest.approx(2, abs=1e-12)


def test_a_table_has_ratios_and_says_where_memory_was_measured() -> None:
    """Who was not there has no row. Bounds are rounded up, and one may be missing."""
    runs = made_up().assign(peak_mb=1234.4, relative_bound=0.00401)
    runs.loc[runs["way"] == "skfem", "relative_bound"] = math.inf
    table = xr.Dataset.from_dataframe(runs)
    rows = benchmark_tables.solvers(table).set_index("`natural`, H = 2h")
    ways = ("multigrid", "recursive newton", "fenicsx", "skfem", "ngsolve")
    assert list(rows.index) == [benchmark_tables.NAMES[way] for way in ways]
    assert rows["66 049 unknowns"].tolist() == ["1 s", "× 4 (4 s)", "× 3 (3 s)", "× 5 (5 s)", "× 2 (2 s)"]
    assert rows["1 050 625 unknowns"].tolist() == ["16 s", "× 4 (64 s)", "× 3 (48 s)", "× 5 (80 s)", "–"]
    assert rows["peak memory"].tolist() == ["1234 MB"] * 4 + ["1234 MB (at 263 169)"]
    bounds = ["0.41 %", "0.41 %", "0.41 %", "none", "0.41 % (at 263 169)"]
    assert rows["guaranteed error of u"].tolist() == bounds


def test_reads_of_the_matrix_and_the_share_of_peak_are_those_by_hand() -> None:
    """A has 7 entries of 12 bytes and a start of 4 in each of 4 rows: 352 bytes, read ten times a second."""
    linear = {"way": "linear", "problem": "natural", "n": 1, "H_over_h": 0, "solve_cpu": 1.0}
    eliminated = {"way": "recursive uzawa", "problem": "natural", "n": 1, "H_over_h": 2}
    runs = pd.DataFrame([linear, {**eliminated, "operations": 50.0, "assembly_cpu": 5.0}])
    machine = xr.Dataset({"bandwidth": 3520.0, "flop_rate": 40.0})
    assert judge.reads(runs, machine, 1) == pytest.approx(10)
    assert judge.share_of_peak(runs, machine, 1) == pytest.approx(0.25)


@pytest.fixture
def started_modules(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The modules that are started; none is run, and each says what a driver or the judge would say."""
    modules: list[str] = []

    def start(python: str, module: str, *arguments: object) -> str:
        modules.append(f"{module} {arguments[0]}" if module == "benchmarks.problem" else module)
        report = record(1, 0)
        return json.dumps(
            {name: report[name] for name in ("start", "peak_mb", "results", "reference", "errors")}
        )

    monkeypatch.setattr(runner, "run_module", start)
    return modules


def test_a_run_that_was_stopped_goes_on_where_it_was(tmp_path: Path, started_modules: list[str]) -> None:
    run_plan = small(tmp_path)
    runs = plan.runs(run_plan)
    first = runner.Runner(run_plan, tmp_path).all(runs)
    assert len(first) == len(runs) == 4
    # Two runs to fill caches, four that count; of each solver one is judged.
    assert started_modules.count("benchmarks.ours") == 6
    assert started_modules.count("benchmarks.problem judge") == 2
    started_modules.clear()
    assert runner.Runner(run_plan, tmp_path).all(runs) == first
    assert started_modules == []
    (tmp_path / f"{runs[-1].name}.json").unlink()
    runner.Runner(run_plan, tmp_path).all(runs)
    assert started_modules.count("benchmarks.ours") == 1


def test_a_process_keeps_its_compiled_modules_and_has_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else each run would compile this project's modules again, which an installation has compiled."""
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    environment = runner.one_thread_environment()
    assert "PYTHONDONTWRITEBYTECODE" not in environment
    assert environment["OMP_NUM_THREADS"] == "1"


def test_a_run_with_other_settings_is_made_anew(tmp_path: Path, started_modules: list[str]) -> None:
    path = small(tmp_path)
    runner.Runner(path, tmp_path).all(plan.runs(path))
    started_modules.clear()
    runner.Runner(path, tmp_path).all(plan.runs({**path, "stop": 0.05}))
    assert started_modules.count("benchmarks.ours") == 6


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("data") / "natural-16.npz"
    problem.prepare(make_order(), path)
    return path


def make_order(**keywords: Any) -> dict[str, Any]:
    return {**plan.order_of(plan.read(COMMITTED), "natural", N), "H_over_h": 2, **keywords}


def test_the_judge_s_error_is_that_by_quadrature(data: Path, tmp_path: Path) -> None:
    known_table = np.load(data)
    rng = np.random.default_rng(0)
    mesh = problem.mesh_of(make_order())
    v = known_table["w"] + 0.01 * rng.standard_normal(len(known_table["w"]))
    order = rng.permutation(len(known_table["w"]))
    np.savez(
        tmp_path / "found.npz", points=known_table["points"][order], u_0=v[order], u_1=known_table["w"][order]
    )
    judged = problem.judge(make_order(), data, tmp_path / "found.npz")
    case = cases.load_solution("natural", square())
    # The degree of the rule leaves 1e-9 of the squares.
    assert judged["errors"] == pytest.approx([h1_distance(case, mesh, v), judged["reference"]], rel=1e-8)
    assert judged["errors"][0] > 1.5 * judged["reference"]
    bounds = np.array([certified["bound"] for certified in judged["certified"]])
    assert all(bounds >= judged["errors"])
    assert bounds[1] < 1.5 * judged["errors"][1]
    assert "certified" not in problem.judge(make_order(certify=False), data, tmp_path / "found.npz")


def test_where_no_bound_is_given_it_is_infinite(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `ul.certify` does where a bound takes more memory than is free."""
    monkeypatch.setattr("unilateral.solution.bounds.explain_memory_shortage", lambda *_: "no memory")
    mesh = problem.mesh_of(make_order())
    with pytest.warns(SolutionWarning, match="no memory"):
        certified = problem.certify(problem.find_problem(make_order()), mesh, np.load(data)["w"])
    assert (certified["bound"], certified["relative_bound"]) == (math.inf, math.inf)


def test_between_slivers_others_stop_later(tmp_path: Path) -> None:
    """With the plan's factor scikit-fem's u is accurate enough. Control: without it, it is not."""
    read = plan.read(COMMITTED)
    runs = {run.solver: run for run in plan.runs(read, [256]) if run.problem == "slivers"}
    usual = read["solvers"]["skfem"]["settings"]["tolerance"]
    order = {**runs["skfem"].order, "n": 128, "certify": False}
    assert order["tolerance"] == pytest.approx(0.1 * usual, rel=1e-12)
    assert "tolerance" not in runs["multigrid"].order
    slivers = tmp_path / "slivers.npz"
    problem.prepare(order, slivers)
    excess = []
    for tolerance in (order["tolerance"], usual):
        solution = tmp_path / "found.npz"
        module = read["solvers"]["skfem"]["module"]
        runner.run_module(sys.executable, module, slivers, solution, {**order, "tolerance": tolerance})
        judged = problem.judge(order, slivers, solution)
        excess.append(judged["errors"][0] / judged["reference"] - 1)
    assert excess[0] <= read["within"] < excess[1]


def test_nodes_of_another_mesh_are_refused() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 0.5]])
    assert match_nodes(points, points[[2, 0, 1]]).tolist() == [1, 2, 0]
    with pytest.raises(ValueError, match="not the nodes of one mesh"):
        match_nodes(points, points + 0.01)


@pytest.mark.parametrize(
    "solver", ["multigrid", "linear", "recursive", "sparse", "skfem", "skfem_amg", "proximal"]
)
def test_a_tiny_run_finds_the_solution(solver: str, data: Path, tmp_path: Path) -> None:
    """On cells of two edges, or by nodes, within the plan's share of the discrete solution's error."""
    read = plan.read(COMMITTED)
    computed = tmp_path / "found.npz"
    settings = read["solvers"][solver]
    document = json.loads(
        runner.run_module(
            sys.executable, settings["module"], data, computed, make_order(**settings["settings"])
        )
    )
    assert document["peak_mb"] > 10
    errors = problem.judge(make_order(), data, computed)["errors"]
    reference = float(np.load(data)["error"])
    comparable = [result.get("H_over_h") != 4 for result in document["results"]] if errors else []
    assert bool(errors) != (solver == "linear")
    assert all(np.array(errors)[comparable] <= (1 + read["within"]) * reference)
    assert all(seconds >= 0 for result in document["results"] for seconds, _ in result["phases"].values())


def test_all_that_was_measured_reached_the_error() -> None:
    """On cells of two edges and with nodal constraints, on meshes fine enough for the problem."""
    runs = tables.load_table(ROOT / "benchmarks/results.nc").to_dataframe()
    judged = runs[runs["over_discrete"].notna() & benchmark_tables.comparable(runs)]
    assert len(judged) > 20
    assert (judged["over_discrete"] <= 1 + plan.read(COMMITTED)["within"]).all()
