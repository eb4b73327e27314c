"""What is to run, from a YAML file: the runs, one after the other, each with all that its driver is told."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from unilateral.errors import InputError
from unilateral.system import declarations

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
        """The name of the file that holds what was measured."""
        return f"{self.solver}-{self.problem}-{self.n}-{self.order['H_over_h']}-{self.repeat}"


def read(path: Path) -> dict[str, Any]:
    """The file's fields. Raises InputError for what the schema does not allow, and for unknown names."""
    plan = declarations.validate(
        declarations.read_declaration(path, path.name, floats=True), FOLDER / "schema.yaml", path.name
    )
    for where, entries in {"runs": plan["runs"], "commands.beside": plan["commands"]["beside"]}.items():
        for i, entry in enumerate(entries):
            for field in ("solvers", "problems"):
                _check(plan, f"{path.name}, field {where}[{i}].{field}", field, entry[field])
    _check(plan, f"{path.name}, field commands.solvers", "solvers", plan["commands"]["solvers"])
    for name in plan["scores"]["drivers"]:
        if name not in plan["solvers"]:
            raise InputError(
                f"{path.name}, field scores.drivers: '{name}' is none of {', '.join(plan['solvers'])}"
            )
    return plan


def _check(plan: dict[str, Any], where: str, field: str, names: Sequence[str]) -> None:
    for name in names:
        if name not in plan[field]:
            valid_names = ", ".join(plan[field])
            raise InputError(f"{where}: '{name}' is unknown; it has to be one of {valid_names}")


def runs(plan: dict[str, Any], sizes: Sequence[int] = ()) -> list[Run]:
    """All runs, of the given sizes only if there are any; solvers take turns, so that all see one machine."""
    return [run for entry in plan["runs"] for run in _list_driver_runs(plan, entry, sizes or entry["sizes"])]


def commands(plan: dict[str, Any], sizes: Sequence[int] = ()) -> list[Run]:
    """All runs of whole processes, which take turns; those with an accuracy have n = 0, and no size."""
    declared = plan["commands"]
    command_runs = [
        run for entry in declared["typed"] for run in _list_typed_runs(entry, declared["solvers"], sizes)
    ]
    command_runs += [
        run for entry in declared["beside"] for run in _list_driver_runs(plan, entry, sizes or entry["sizes"])
    ]
    return sorted(command_runs, key=lambda run: run.repeat)


def _list_typed_runs(entry: dict[str, Any], solvers: Sequence[str], sizes: Sequence[int]) -> Iterator[Run]:
    file = entry["solve"]
    accuracy = entry.get("accuracy")
    options_by_size = {n: ["--h", f"1/{n}", "--H", f"1/{n // CELLS}"] for n in entry.get("sizes", [])}
    if sizes:
        options_by_size = {n: sized for n, sized in options_by_size.items() if n in sizes}
    elif accuracy:
        options_by_size = {0: ["--accuracy", f"{accuracy:g}"]}
    for n, options in options_by_size.items():
        order = {"H_over_h": CELLS, "typed": ["solve", file, *options]}
        for repeat in range(entry.get("repeats", REPEATS)):
            for solver in solvers:
                yield Run(solver, f"{Path(file).stem}{accuracy or ''}", n, repeat, order)


def _list_driver_runs(plan: dict[str, Any], entry: dict[str, Any], sizes: Sequence[int]) -> Iterator[Run]:
    for problem in entry["problems"]:
        for n in sorted({*entry["sizes"]} & {*sizes}):
            for repeat in range(entry.get("repeats", REPEATS)):
                for solver in entry["solvers"]:
                    order = {**order_of(plan, problem, n), "H_over_h": entry.get("H_over_h", CELLS)}
                    yield Run(solver, problem, n, repeat, order | _read_settings(plan, solver, problem))


def _read_settings(plan: dict[str, Any], solver: str, problem: str) -> dict[str, Any]:
    """What the driver of a solver is told, with the problem's `tolerance_factor` in its tolerance."""
    settings = dict(plan["solvers"][solver]["settings"])
    if "tolerance" in settings:
        settings["tolerance"] *= plan["problems"][problem].get("tolerance_factor", 1)
    return settings


def order_of(plan: dict[str, Any], problem: str, n: int) -> dict[str, Any]:
    """The fields of an order from which the problem's data are made."""
    declared = plan["problems"][problem]
    where = {"case": declared["case"], "polygon": declared["polygon"], "flat": declared.get("flat", 1)}
    judge = {"judged": plan["judged"], "certify": declared.get("certify", False)}
    return {**where, "problem": problem, "n": n, "stop": plan["stop"], **judge}


def interpreter(plan: dict[str, Any], solver: str) -> str:
    """The Python that runs a solver's driver."""
    default = plan["solvers"][solver].get("python", sys.executable)
    return os.environ.get(f"UNILATERAL_BENCH_{solver.upper()}", default)


def missing(plan: dict[str, Any], solver: str) -> str:
    """Why a solver cannot run here, or nothing."""
    python = interpreter(plan, solver)
    needed = plan["solvers"][solver].get("imports", [])
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
    texts = [json.dumps(argument) if isinstance(argument, dict) else str(argument) for argument in arguments]
    return [python, "-m", module, *texts]
