"""Whole processes: which run, what counts, how they are resumed and summed up, and tiny ones."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import sentences
import yaml
from conftest import ROOT
from documents import blocks

from benchmarks import commands, plan, problem
from benchmarks import numbers as documented
from benchmarks.commands import ProcessRunner
from unilateral import api
from unilateral.errors import InputError

COMMITTED = ROOT / "benchmarks/benchmarks.yaml"
PLAN = plan.read(COMMITTED)
OWN = "benchmarks/cases/own.yaml"
MB = 100


def small(**changes: Any) -> dict[str, Any]:
    """A plan of one command, typed twice."""
    plan_data = {
        "solvers": ["unilateral"],
        "typed": [{"solve": OWN, "sizes": [8], "repeats": 2}],
        "beside": [],
    }
    return {**PLAN, "commands": plan_data | changes}


def test_all_take_turns_and_each_is_named_once() -> None:
    runs = plan.commands(PLAN)
    assert len({run.name for run in runs}) == len(runs)
    assert [run.repeat for run in runs] == sorted(run.repeat for run in runs)
    largest = [run for run in runs if run.n == 2048 and run.solver == "unilateral"]
    assert [run.order["typed"] for run in largest] == [["solve", OWN, "--h", "1/2048", "--H", "1/1024"]]
    assert {run.order["typed"][-1] for run in runs if run.n == 0} == {"0.002", "0.005"}
    assert {run.n for run in plan.commands(PLAN, [32])} == {32}


def test_an_unknown_solver_is_refused(tmp_path: Path) -> None:
    spoilt = yaml.safe_load(COMMITTED.read_text())
    spoilt["commands"]["solvers"] = ["abacus"]
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(spoilt))
    with sentences.raises(InputError):
        plan.read(tmp_path / "plan.yaml")


def answer(**changes: Any) -> str:
    """What `unilateral solve --json` would print of a search of two levels."""
    answer = {"unknowns": 300, "h1_relative_bound": 0.01, "converged": True, "certified": True}
    levels = [{"unknowns": 100}, {"unknowns": 300}]
    return json.dumps({**answer, "goal": {"accuracy": 0.02}, "levels": levels} | changes)


@pytest.mark.parametrize("spoilt", [{"certified": False}, {"converged": False}, {"h1_relative_bound": None}])
def test_an_answer_counts_only_if_it_is_certified(spoilt: dict[str, Any]) -> None:
    """The levels have 400 unknowns together. On given sizes there is no accuracy to certify."""
    report = {"unknowns": 300, "relative_bound": 0.01}
    assert commands.read_certified_answer(answer()) == report | {"levels_over_last": pytest.approx(4 / 3)}
    assert commands.read_certified_answer(answer(goal=None, certified=False, levels=[])) == report | {
        "levels_over_last": 1
    }
    with sentences.raises(InputError):
        commands.read_certified_answer(answer(**spoilt))


def test_the_bound_is_told_over_all_that_is_before_it() -> None:
    phases = {"mesh": [1.0, 9.0], "solve": [3.0, 9.0]}
    phases_by_bound = {False: phases, True: phases | {"bound": [2.0, 9.0]}}
    outputs = {
        bound: "noise\n" + json.dumps({"results": [{"phases": value}]})
        for bound, value in phases_by_bound.items()
    }
    assert commands.read_bound_ratio(outputs[True]) == {"bound_over_solve": 0.5}
    assert commands.read_bound_ratio(outputs[False]) == {}


def test_a_process_is_measured_with_its_children_and_a_failure_is_told() -> None:
    """The child of a child holds 100 MB. What starts them counts, too, so there is no upper limit here."""
    holds = f"[sys.executable, '-c', 'x = b\"1\" * {MB} * 2**20']"
    child = f"import subprocess, sys; subprocess.run({holds}); print(7)"
    output, took = commands.process([sys.executable, "-c", child])
    assert output == "7\n"
    assert took["peak_mb"] > MB
    assert took["cpu_seconds"] > 0
    with sentences.raises(InputError):
        commands.process([sys.executable, "-c", "raise SystemExit('nothing goes')"])


@pytest.fixture
def started_commands(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The commands that are started; none is run, and all are answered."""
    started: list[list[str]] = []

    def process(command: list[str]) -> tuple[str, dict[str, float]]:
        started.append(command)
        return answer(), {"cpu_seconds": float(len(started)), "wall": 1.0, "peak_mb": 80.0}

    monkeypatch.setattr(commands, "process", process)
    return started


def test_commands_that_were_stopped_go_on_where_they_were(
    tmp_path: Path, started_commands: list[list[str]]
) -> None:
    """The first one fills caches: it is run once more, and its second is not told."""
    runs = plan.commands(small())
    first = ProcessRunner(small(), tmp_path).all(runs)
    expected = [sys.executable, "-m", "unilateral", "solve", OWN, "--h", "1/8", "--H", "1/4", "--json"]
    assert started_commands == [expected] * 3
    assert [record["cpu_seconds"] for record in first] == [2, 3]
    assert ProcessRunner(small(), tmp_path).all(runs) == first
    (tmp_path / f"{runs[1].name}.json").unlink()
    ProcessRunner(small(), tmp_path).all(runs)
    assert len(started_commands) == 4


def test_a_command_that_fails_is_told_and_does_not_count(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A bad option, code 2; and an accuracy that so few unknowns do not reach, code 3."""
    for typed in (["--h", "no number"], ["--accuracy", "0.01", "--max-unknowns", "500"]):
        run = plan.Run("unilateral", "own", 8, 0, {"H_over_h": 2, "typed": ["solve", OWN, *typed]})
        assert ProcessRunner(small(), tmp_path).all([run]) == []
    lines = capfd.readouterr().err.splitlines()
    assert lines[0].startswith("benchmarks: unilateral-own-8-2-0 does not count: it ended with code 2")
    assert any("it ended with code 3" in line for line in lines)


def test_the_typed_bound_is_that_of_the_data_given_to_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The bound that is typed is that of the data which others are given, but for the iteration.

    So is the one by which `ul.certify` judges the same u. Its processes import what they need: seconds. No
    caches are filled before. Control: a u does not count whose bound is too large for that of this project.
    """
    run = {"solvers": ["bound", "skfem"], "problems": ["own"], "sizes": [16], "repeats": 1}
    run_plan = small(typed=[{"solve": OWN, "sizes": [16], "repeats": 1}], beside=[run])
    runner = ProcessRunner(run_plan, tmp_path)
    runner.paces = dict.fromkeys(("unilateral", "bound", "skfem"), 0.0)
    runs = plan.commands(run_plan)
    ours, bound, skfem = commands.rows(runner.all(runs))
    assert ours["typed"] == f"unilateral solve {OWN} --h 1/16 --H 1/8"
    assert (ours["unknowns"], bound["unknowns"], skfem["unknowns"]) == (289, 289, 289)
    assert bound["bound_over_solve"] > 0
    assert bound["over_bound"] == pytest.approx(1, rel=0.01)
    assert bound["relative_bound"] == pytest.approx(ours["relative_bound"], rel=0.01)
    assert 0 < skfem["relative_bound"] < 1.5 * ours["relative_bound"]
    assert skfem["certify_cpu"] > 0
    assert "certify_cpu" not in ours
    path = tmp_path / "data/own-16.npz"
    expected = dict(np.load(path))
    s = api.solve(ROOT / OWN, h=1 / 16, H=1 / 8)
    assert s.bounds is not None
    assert float(expected["error"]) == pytest.approx(s.bounds.u, rel=0.01)
    boundary = expected[f"boundary_{expected['n_levels'] - 1}"]
    assert expected["obstacle"] == pytest.approx(_g(*expected["points"][boundary].T), abs=1e-15)
    np.savez(path, **{**expected, "error": expected["error"] / (2 * commands.MAX_BOUND_RATIO)})
    assert runner.make_record(runs[-1]) == {}
    assert "does not count: the guaranteed error of its u is more than twice" in capsys.readouterr().err


def test_a_problem_of_a_user_enters_by_its_file_and_its_polygon(tmp_path: Path) -> None:
    """As the page shows it, with a smaller size: 16 by 8 squares have 17 * 9 nodes.

    Control: a coefficient that the drivers do not know is refused.
    """
    (entries,) = [block.text for block in blocks("docs/which-solver.md") if block.kind == "yaml"]
    entered = yaml.safe_load(entries)
    pool = entered["problems"]["pool"]
    file = tmp_path / "pool.yaml"
    fields = {"title": "a pool", "polygon": pool["polygon"], "f": "x - 2", "g": "-y/10"}
    file.write_text(yaml.safe_dump(fields))
    (beside,) = entered["commands"]["beside"]
    beside |= {"solvers": ["bound", "skfem"], "sizes": [8], "repeats": 1}
    read_plan = yaml.safe_load(COMMITTED.read_text())
    read_plan["problems"]["pool"] = {**pool, "case": str(file)}
    read_plan["commands"] |= {"typed": [], "beside": [beside]}
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(read_plan))
    run_plan = plan.read(tmp_path / "plan.yaml")
    runner = ProcessRunner(run_plan, tmp_path)
    runner.paces = dict.fromkeys(("bound", "skfem"), 0.0)
    runs = plan.commands(run_plan)
    bound, skfem = commands.rows(runner.all(runs))
    assert (bound["unknowns"], skfem["unknowns"]) == (153, 153)
    s = api.solve(file, h=1 / 8, H=1 / 4)
    assert s.bounds is not None
    assert bound["relative_bound"] == pytest.approx(s.bounds.relative_u, rel=0.01)
    assert skfem["over_bound"] < commands.MAX_BOUND_RATIO
    file.write_text(yaml.safe_dump({**fields, "k": 2}))
    with sentences.raises(InputError):
        problem.prepare(runs[0].order, tmp_path / "data.npz")


def _g(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return x * (1 - x) / 3 - y * (1 - y) / 5


def record(cpu: float, **keywords: Any) -> dict[str, Any]:
    report = {"solver": "skfem", "problem": "own", "n": 1024, "unknowns": 1025**2, "order": {}}
    return {**report, "cpu_seconds": cpu, "wall": 2 * cpu, "peak_mb": 100.0} | keywords


def test_a_summary_has_medians_and_the_spread() -> None:
    (row,) = commands.rows([record(12), record(1), record(2)])
    assert (row["cpu_seconds"], row["cpu_least"], row["cpu_most"], row["repeats"]) == (2, 1, 12, 3)
    assert row["wall"] == 4
    assert not {"relative_bound", "over_ours"} & set(row)
    ours = record(4, solver="unilateral")
    assert [row["over_ours"] for row in commands.rows([record(10), ours])] == [2.5, 1]


def make_records() -> dict[str, Any]:
    """A command of 4 s, its bound and a peer of 10 s, whose u is certified in 2 s."""
    typed = {"solver": "unilateral", "order": {"typed": ["solve", "own.yaml"]}, "relative_bound": 0.0004561}
    bound = {"solver": "bound", "bound_over_solve": 0.75}
    certified = {"relative_bound": 0.0005, "certify_cpu": 2.0}
    records = [record(4, levels_over_last=1.0, **typed), record(5, **bound), record(10, **certified)]
    return {"date": "today", "processor": "P", "rows": commands.rows(records)}


def test_the_table_shows_what_is_typed_and_then_the_others() -> None:
    """4 s over 1 050 625 unknowns are 3.8 microseconds; bounds are rounded up."""
    table = documented.commands(make_records())
    assert table.to_numpy().tolist() == [
        ["`unilateral solve own.yaml`", "1 050 625", "4 s", "3.8 µs", "100 MB", "0.046 %", "in the command"],
        [
            "scikit-fem, PyAMG's cycle on the meshes, active set, nodal",
            "1 050 625",
            "10 s",
            "9.5 µs",
            "100 MB",
            "0.051 %",
            "2 s",
        ],
    ]
    numbers = documented.command_numbers(make_records())
    assert numbers["bound_over_solve"] == 0.75
    assert (numbers["fastest"]["over_ours"], numbers["fastest"]["memory_over_ours"]) == (2.5, 1)
    assert numbers["fastest"]["certified_over_ours"] == 3


def test_what_is_committed_is_what_the_plan_asks_for() -> None:
    """All was certified; of others there is whoever was there."""
    stored = json.loads((ROOT / "benchmarks/commands.json").read_text(encoding="utf-8"))
    rows = pd.DataFrame(stored["rows"])
    expected = {(run.problem, run.n) for run in plan.commands(PLAN) if run.solver == "unilateral"}
    ours = rows[rows["solver"] == "unilateral"]
    assert set(zip(ours["problem"], ours["n"], strict=True)) == expected
    assert (rows["relative_bound"] > 0).all()
    assert (rows.loc[rows["solver"] != "unilateral", "certify_cpu"] > 0).all()
    assert set(rows["solver"]) >= {"bound", "skfem"}
