"""`make bench`: runs what has not yet run, one process after the other, and writes benchmarks/results.nc.

With sizes, as in `make bench sizes="256"`, these only, and the table is printed, not written. A run that
was stopped resumes: `benchmarks/runs` holds finished runs. Remove that folder to measure anew.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks import plan
from benchmarks.plan import FOLDER, ROOT, Run
from unilateral.errors import InputError
from unilateral.system.files import replacing

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")
SECONDS_PER_START = 3.0
SECONDS_PER_UNKNOWN_GUESS = 2e-5
"""Seconds for the processes of a run, and for an unknown before anything is known of a solver."""


class Runner:
    """The plan, and the folder with the data of problems and a file for each run."""

    def __init__(self, run_plan: dict[str, Any], folder: Path) -> None:
        self.plan = run_plan
        self.folder = folder
        (folder / "data").mkdir(parents=True, exist_ok=True)
        self.paces: dict[str, float] = {}

    def all(self, runs: list[Run]) -> list[dict[str, Any]]:
        """The records of all runs, of which those are made that there are not."""
        records = [self.read_record(run) for run in runs]
        waiting = [run for run, record in zip(runs, records, strict=True) if record is None]
        for record in filter(None, records):
            self.learn(record)
        for k, run in enumerate(waiting):
            minutes = sum(map(self.expect_seconds, waiting[k:])) / 60
            print(f"{k + 1} of {len(waiting)}: {run.name}; about {minutes:.0f} min left", flush=True)
            self.learn(self.make_record(run))
        return [record for record in map(self.read_record, runs) if record]

    def read_record(self, run: Run) -> dict[str, Any] | None:
        """The record of the same run, if there is one."""
        path = self.folder / f"{run.name}.json"
        record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        return record if record.get("order") == run.order else None

    def expect_seconds(self, run: Run) -> float:
        """The wall-clock seconds that a run is expected to take, by the pace of its solver's runs so far."""
        return SECONDS_PER_START + self.paces.get(run.solver, SECONDS_PER_UNKNOWN_GUESS) * run.n**2

    def learn(self, record: dict[str, Any]) -> None:
        """Note how fast a solver is: seconds per unknown."""
        self.paces[record["solver"]] = max(record["seconds"] - SECONDS_PER_START, 0) / record["n"] ** 2

    def make_record(self, run: Run) -> dict[str, Any]:
        """The record of a run that is made now; a solver's first run is made twice, to fill its caches."""
        start = time.perf_counter()
        data = self.data(run)
        solution_file = self.folder / "found.npz"
        if run.solver not in self.paces:
            self.measure(run, data, solution_file)
        measured = {**self.measure(run, data, solution_file), **self.judge_solution(run, data, solution_file)}
        record = {"solver": run.solver, "problem": run.problem, "n": run.n, "order": run.order, **measured}
        record["seconds"] = time.perf_counter() - start
        with replacing(self.folder / f"{run.name}.json") as temporary:
            temporary.write_text(json.dumps(record), encoding="utf-8")
        return record

    def data(self, run: Run) -> Path:
        """The file of the problem's data, made if it is not there; beyond `judged` that of this size, too."""
        for n in sorted({min(run.n, self.plan["judged"]), run.n}):
            path = self.folder / "data" / f"{run.problem}-{n}.npz"
            if not path.exists():
                run_module(sys.executable, "benchmarks.problem", "prepare", {**run.order, "n": n}, path)
        return path

    def measure(self, run: Run, data: Path, solution_file: Path) -> dict[str, Any]:
        """The driver's report."""
        module = self.plan["solvers"][run.solver]["module"]
        output = run_module(plan.interpreter(self.plan, run.solver), module, data, solution_file, run.order)
        measured: dict[str, Any] = json.loads(output.splitlines()[-1])
        return measured

    def judge_solution(self, run: Run, data: Path, solution_file: Path) -> dict[str, Any]:
        """The errors of what was found, in the first of the repeats: the others find the same."""
        if run.repeat > 0 or run.n > self.plan["judged"]:
            return {}
        output = run_module(sys.executable, "benchmarks.problem", "judge", run.order, data, solution_file)
        judged: dict[str, Any] = json.loads(output)
        return judged


def run_module(python: str, module: str, *arguments: object) -> str:
    """The output of a module of the benchmarks, run on one thread in a process of its own."""
    command = plan.command(python, module, *arguments)
    done = subprocess.run(command, cwd=ROOT, env=one_thread_environment(), capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"{module} failed on {arguments}: {done.stderr.strip()[-500:]}")
    return done.stdout


def one_thread_environment() -> dict[str, str]:
    """The environment of what is measured: one thread, and modules stay compiled, as installed ones are."""
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    return environment


def available(
    run_plan: dict[str, Any], sizes: list[str], listed: Callable[..., list[Run]] = plan.runs
) -> list[Run]:
    """The runs that are listed, of those sizes if there are any, whose solvers are there.

    It is said who is missing. Raises InputError for a size that neither a run nor a command has.
    """
    valid_sizes = sorted({run.n for run in plan.runs(run_plan) + plan.commands(run_plan)} - {0})
    for size in sizes:
        if size not in map(str, valid_sizes):
            raise InputError(
                f"there is no run of size '{size}'; sizes are {', '.join(map(str, valid_sizes))}"
            )
    runs = listed(run_plan, [int(size) for size in sizes])
    lacking = {solver: plan.missing(run_plan, solver) for solver in dict.fromkeys(run.solver for run in runs)}
    for reason in filter(None, lacking.values()):
        print(f"benchmarks: {reason}", file=sys.stderr)
    return [run for run in runs if not lacking[run.solver]]


def main(sizes: list[str]) -> int:
    """Runs the plan, or the part of those sizes."""
    try:
        run_plan = plan.read(FOLDER / "benchmarks.yaml")
        records = Runner(run_plan, FOLDER / "runs").all(available(run_plan, sizes))
        machine = json.loads(run_module(sys.executable, "benchmarks.machine"))
    except InputError as fault:
        print(f"benchmarks: {fault}", file=sys.stderr)
        return fault.exit_code
    from benchmarks import summary  # not before: what is started counts the peak memory of who starts it
    from study import tables

    if sizes and records:
        print(summary.rows(records).to_string(index=False))
    elif not sizes:
        tables.save_table(summary.dataset(records, machine), FOLDER / "results.nc", "benchmarks")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
