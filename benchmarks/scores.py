"""`make score`: the drivers in examples/, each on some cases, scored; writes benchmarks/scores.csv.

A driver whose package is not there is skipped, and it is said so.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from benchmarks import plan
from benchmarks.plan import FOLDER, ROOT
from unilateral import api
from unilateral.errors import InputError
from unilateral.exchange import score as scores
from unilateral.exchange.export import export_case
from unilateral.exchange.exported_folder import read_exported_folder, read_foreign_solution
from unilateral.formulas.formula import parse_real
from unilateral.system.files import replacing

DIGITS = 4
"""That are stored: more of them depend on the processor."""


def solutions(python: str, driver: Path, case: str) -> list[tuple[str, str | None]]:
    """A driver's files of u for the exported folder of that name, each with that of multipliers if any.

    Raises InputError with what the driver says if it fails.
    """
    done = subprocess.run([python, str(driver), case], capture_output=True, text=True)
    if done.returncode:
        raise InputError(f"{driver.name} ended with code {done.returncode}: {done.stderr.strip()[-500:]}")
    u_files = sorted(map(str, Path().glob(f"{case}*_?.csv")))
    multiplier_files = sorted(map(str, Path().glob(f"{case}*_cells.csv")))
    return list(zip_longest(u_files, multiplier_files))


def score_driver(python: str, driver: Path, name: str, sizes: dict[str, Any]) -> dict[str, Any]:
    """How a driver does on a case: ratios on the finest level, the rates beside this project's, a verdict."""
    h = parse_real(sizes["h"], "h")
    H = parse_real(sizes["H"], "H")
    levels = sizes["levels"]
    case = api.case(name)
    with TemporaryDirectory() as folder, chdir(folder):
        export_case(case, api.MESH_KINDS["structured"](case.polygon, h * 2 ** (levels - 1)), H, levels, name)
        exported, meshes = read_exported_folder(name)
        foreign_solutions = [
            read_foreign_solution(meshes, *files) for files in solutions(python, driver, name)
        ]
    scored_solutions = [scores.score_solution(exported, score) for score in foreign_solutions]
    rates = scores.compute_rates(exported, scored_solutions)
    finest = min(scored_solutions, key=lambda score: score.solution.level.mesh.h)
    row: dict[str, Any] = {
        "case": name,
        "h": sizes["h"],
        "H": sizes["H"],
        "multiplier": finest.solution.multiplier_kind,
    }
    for norm, rate in rates.items():
        ratio = scores.select_error(finest.errors, norm) / scores.select_error(finest.reference_errors, norm)
        row |= {f"{norm}_over_own": ratio, f"{norm}_rate": rate.observed, f"{norm}_own_rate": rate.own}
    return row | {
        "faults": sum(len(score.faults) for score in scored_solutions),
        "verdict": scores.state_verdict(scored_solutions, rates),
    }


def rows(run_plan: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A row per case and driver whose package is there."""
    for solver, driver in run_plan["scores"]["drivers"].items():
        lacking = plan.missing(run_plan, solver)
        if lacking:
            print(f"score: {lacking}", file=sys.stderr)
            continue
        for case in run_plan["scores"]["cases"]:
            print(f"{solver}: {case}", flush=True)
            python = plan.interpreter(run_plan, solver)
            yield {"solver": solver, **score_driver(python, ROOT / driver, case, run_plan["scores"])}


def main() -> int:
    """Writes the table."""
    try:
        table = pd.DataFrame(rows(plan.read(FOLDER / "benchmarks.yaml")))
    except InputError as fault:
        print(f"score: {fault}", file=sys.stderr)
        return fault.exit_code
    numbers = table.select_dtypes("float").map(lambda x: float(np.format_float_scientific(x, DIGITS - 1)))
    with replacing(FOLDER / "scores.csv") as temporary:
        table.assign(**numbers).to_csv(temporary, index=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
