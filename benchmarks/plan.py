"""What is to run, from a YAML file: the runs, one after the other, each with all that its driver is told."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from unilateral import declarations
from unilateral.errors import InputError

FOLDER = Path(__file__).parent
ROOT = FOLDER.parent
CELLS = 2
"""Edges in a cell where nothing else is said."""
OTHER = {2: 4, 4: 2}
"""Edges in a cell of the further problem on the same hierarchy."""
REPEATS = 3


class Run(NamedTuple):
    """One process. `order` is what the driver is told; `repeat` counts from 0."""

    solver: str
    problem: str
    n: int
    repeat: int
    order: dict[str, Any]

    @property
    def name(self) -> str:
        """Of the file that holds what was measured."""
        return f"{self.solver}-{self.problem}-{self.n}-{self.order['H_over_h']}-{self.repeat}"


def read(path: Path) -> dict[str, Any]:
    """The file's fields. Raises InputError for what the schema does not allow, and for unknown names."""
    plan = declarations.validate(
        declarations.read(path, path.name, floats=True), FOLDER / "schema.yaml", path.name
    )
    for i, entry in enumerate(plan["runs"]):
        for field in ("solvers", "problems"):
            for name in entry[field]:
                if name not in plan[field]:
                    where, known = f"{path.name}, field runs[{i}].{field}", ", ".join(plan[field])
                    raise InputError(f"{where}: '{name}' is unknown; it has to be one of {known}")
    for name in plan["scores"]["drivers"]:
        if name not in plan["solvers"]:
            raise InputError(
                f"{path.name}, field scores.drivers: '{name}' is none of {', '.join(plan['solvers'])}"
            )
    return plan


def runs(plan: dict[str, Any], sizes: Sequence[int] = ()) -> list[Run]:
    """All runs, of the given sizes only if there are any; solvers take turns, so that all see one machine."""
    return [run for entry in plan["runs"] for run in _of_entry(plan, entry, sizes or entry["sizes"])]


def _of_entry(plan: dict[str, Any], entry: dict[str, Any], sizes: Sequence[int]) -> Iterator[Run]:
    for problem in entry["problems"]:
        for n in sorted({*entry["sizes"]} & {*sizes}):
            for repeat in range(entry.get("repeats", REPEATS)):
                for solver in entry["solvers"]:
                    order = {**order_of(plan, problem, n), "H_over_h": entry.get("H_over_h", CELLS)}
                    yield Run(solver, problem, n, repeat, order | plan["solvers"][solver]["settings"])


def order_of(plan: dict[str, Any], problem: str, n: int) -> dict[str, Any]:
    """What has to be known to make the problem's data."""
    of = plan["problems"][problem]
    where = {"case": of["case"], "polygon": of["polygon"], "flat": of.get("flat", 1)}
    return {**where, "problem": problem, "n": n, "judged": plan["judged"], "stop": plan["stop"]}


def interpreter(plan: dict[str, Any], solver: str) -> str:
    """The Python that runs a solver's driver."""
    default = plan["solvers"][solver].get("python", sys.executable)
    return os.environ.get(f"UNILATERAL_BENCH_{solver.upper()}", default)


def missing(plan: dict[str, Any], solver: str) -> str:
    """Why a solver cannot run here, or nothing."""
    python, needed = interpreter(plan, solver), plan["solvers"][solver].get("imports", [])
    try:
        subprocess.run(
            [python, "-c", f"import {', '.join(['sys', *needed])}"], check=True, capture_output=True
        )
    except (OSError, subprocess.CalledProcessError):
        return (
            f"{solver} is skipped: {python} does not have {', '.join(needed)}; "
            f"install it, or let UNILATERAL_BENCH_{solver.upper()} name an interpreter that has it"
        )
    return ""


def command(python: str, module: str, *arguments: object) -> list[str]:
    """A module of the benchmarks, started in the project's folder; mappings are handed over as JSON."""
    told = [json.dumps(each) if isinstance(each, dict) else str(each) for each in arguments]
    return [python, "-m", module, *told]
