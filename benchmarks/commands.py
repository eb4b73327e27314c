"""Whole processes: what a user types, and drivers of other packages; writes benchmarks/commands.json.

`make bench` runs it, too. Seconds and memory are those of the processes from their start to their end. With
sizes, as in `python -m benchmarks.commands 32`, these only, and nothing is written. If stopped, it resumes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from statistics import median
from tempfile import TemporaryFile
from typing import Any

from benchmarks import plan
from benchmarks.__main__ import (
    SECONDS_PER_UNKNOWN_GUESS,
    Runner,
    available,
    one_thread_environment,
    run_module,
)
from benchmarks.plan import FOLDER, ROOT, Run
from unilateral.errors import InputError
from unilateral.system.files import replacing

MEDIANS = ("cpu_seconds", "wall", "peak_mb", "bound_over_solve", "certify_cpu")
ANSWER_NUMBERS = ("relative_bound", "levels_over_last", "over_bound")
OURS = "unilateral"
MIN_PACE_SIZE = 256
"""Sizes from which on a process tells how fast a solver is."""
MAX_BOUND_RATIO = 2.0
"""Another u is accurate enough if its guaranteed bound is at most this times that of this project's u."""


class ProcessRunner(Runner):
    """The same runner, of whole processes. What fails, or is not certified, is told and does not count."""

    def make_record(self, run: Run) -> dict[str, Any]:
        """The record of a run; empty, with a message, if it does not count."""
        try:
            return super().make_record(run)
        except InputError as fault:
            print(f"benchmarks: {run.name} does not count: {fault}", file=sys.stderr)
            return {}

    def learn(self, record: dict[str, Any]) -> None:
        """Note how fast a solver is, if the run was long enough to tell."""
        if record.get("n", 0) >= MIN_PACE_SIZE:
            super().learn(record)
        elif record:
            self.paces.setdefault(record["solver"], SECONDS_PER_UNKNOWN_GUESS)

    def data(self, run: Run) -> Path:
        """The problem file of a command, or the data for a driver."""
        return Path(run.order["typed"][1]) if "typed" in run.order else super().data(run)

    def measure(self, run: Run, data: Path, solution_file: Path) -> dict[str, Any]:
        """The process's seconds and memory, and its answer."""
        typed = run.order.get("typed")
        module = self.plan["solvers"][run.solver]["module"]
        arguments = [*typed, "--json"] if typed else [data, solution_file, run.order]
        output, resources = process(plan.command(plan.interpreter(self.plan, run.solver), module, *arguments))
        return resources | (read_certified_answer(output) if typed else read_bound_ratio(output))

    def judge_solution(self, run: Run, data: Path, solution_file: Path) -> dict[str, Any]:
        """The guaranteed error of a driver's u, also over that of this project's u, in each repeat.

        Raises InputError beyond MAX_BOUND_RATIO.
        """
        if "typed" in run.order:
            return {}
        judged = super().judge_solution(run._replace(repeat=0), data, solution_file)
        (certified,) = judged["certified"]
        over_bound = certified["bound"] / judged["reference"]
        if over_bound > MAX_BOUND_RATIO:
            raise InputError("the guaranteed error of its u is more than twice that of this project's u")
        return {"unknowns": judged["unknowns"], "over_bound": over_bound, **certified}


def process(command: list[str]) -> tuple[str, dict[str, float]]:
    """A command's output, its processor and wall-clock seconds and MB of 2^20 bytes, with its children's.

    Raises InputError if it fails.
    """
    with TemporaryFile("w+") as out, TemporaryFile("w+") as err:
        start = time.perf_counter()
        running = subprocess.Popen(command, cwd=ROOT, env=one_thread_environment(), stdout=out, stderr=err)
        _, status, used = os.wait4(running.pid, 0)
        wall = time.perf_counter() - start
        running.returncode = os.waitstatus_to_exitcode(status)
        for file in (out, err):
            file.seek(0)
        if running.returncode:
            raise InputError(f"it ended with code {running.returncode}: {err.read().strip()[-500:]}")
        cpu = used.ru_utime + used.ru_stime
        return out.read(), {"cpu_seconds": cpu, "wall": wall, "peak_mb": used.ru_maxrss / 2**10}


def read_certified_answer(output: str) -> dict[str, Any]:
    """Numbers that `solve --json` prints. Raises InputError without a guaranteed relative bound."""
    answer = json.loads(output)
    bound = answer["h1_relative_bound"]
    levels = [level["unknowns"] for level in answer["levels"]]
    if bound is None or not answer["converged"] or (answer["goal"] and not answer["certified"]):
        raise InputError("its answer is not certified")
    over_last = sum(levels) / levels[-1] if levels else 1.0
    return {"unknowns": answer["unknowns"], "relative_bound": bound, "levels_over_last": over_last}


def read_bound_ratio(output: str) -> dict[str, float]:
    """The seconds of the bound over those of the solve, from the output of a driver that bounds its error."""
    (first, *_) = json.loads(output.splitlines()[-1])["results"]
    phases = {name: cpu for name, (cpu, _) in first["phases"].items()}
    bound = phases.pop("bound", None)
    return {} if bound is None else {"bound_over_solve": bound / sum(phases.values())}


def rows(records: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """A row per solver and command, or problem and size: medians over its repeats.

    `over_ours` is a ratio of seconds: how many times faster this project is.
    """
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for record in records:
        groups.setdefault((record["solver"], record["problem"], record["n"]), []).append(record)
    rows_by_key = {key: _row(group) for key, group in groups.items()}
    for (_, *problem_and_size), row in rows_by_key.items():
        ours = rows_by_key.get((OURS, *problem_and_size))
        row |= {"over_ours": row["cpu_seconds"] / ours["cpu_seconds"]} if ours else {}
    return list(rows_by_key.values())


def _row(records: list[Mapping[str, Any]]) -> dict[str, Any]:
    first = records[0]
    seconds = [record["cpu_seconds"] for record in records]
    row = {name: first.get(name) for name in ("solver", "problem", "n", "unknowns")}
    row |= {name: first[name] for name in ANSWER_NUMBERS if name in first}
    if "typed" in first["order"]:
        row["typed"] = " ".join(["unilateral", *first["order"]["typed"]])
    medians = {name: median(repeat[name] for repeat in records) for name in MEDIANS if name in first}
    spread = {"cpu_least": min(seconds), "cpu_most": max(seconds), "repeats": len(records)}
    return {**row, **medians, **spread}


def main(sizes: list[str]) -> int:
    """Runs all commands, or those of the sizes, and prints the table."""
    try:
        run_plan = plan.read(FOLDER / "benchmarks.yaml")
        table = rows(
            ProcessRunner(run_plan, FOLDER / "runs/commands").all(available(run_plan, sizes, plan.commands))
        )
        machine = json.loads(run_module(sys.executable, "benchmarks.machine"))
    except InputError as fault:
        print(f"benchmarks: {fault}", file=sys.stderr)
        return fault.exit_code
    import pandas as pd  # not before: what is started counts the peak memory of who starts it

    print(pd.DataFrame(table).drop(columns=["problem", "wall"], errors="ignore").to_string(index=False))
    if not sizes:
        stored = {name: machine[name] for name in ("date", "processor")} | {"rows": table}
        with replacing(FOLDER / "commands.json") as temporary:
            temporary.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
