"""The runs as a table: of each way, problem and size the median over its repeats."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

PHASES = {"mesh": "mesh_cpu", "assembly": "assembly_cpu", "operator": "assembly_cpu", "solve": "solve_cpu"}
KEYS = ["way", "problem", "n", "H_over_h"]
MEDIANS = (
    *("cpu_seconds", "wall", "start_cpu", "mesh_cpu", "assembly_cpu", "solve_cpu"),
    *("peak_mb", "iterations", "sets", "h1_error", "over_discrete", "operations"),
    *("relative_bound", "certify_cpu"),
)
Record = Mapping[str, Any]


def rows(records: Iterable[Record]) -> pd.DataFrame:
    """A row per way, problem, n and H/h, 0 where there are no cells; what nobody measured is NaN."""
    results = pd.DataFrame([row for record in records for row in list_result_rows(record)])
    grouped = results.groupby(KEYS, sort=False)
    medians = grouped[list(MEDIANS)].median()
    seconds = grouped["cpu_seconds"]
    medians["cpu_least"] = seconds.min()
    medians["cpu_most"] = seconds.max()
    medians["repeats"] = seconds.count()
    return medians.reset_index()


def list_result_rows(record: Record) -> list[dict[str, Any]]:
    """A row per result of a run; errors are measured, and certified, in one of its repeats."""
    errors = record.get("errors") or [np.nan] * len(record["results"])
    certified = record.get("certified") or [{}] * len(record["results"])
    return [
        {
            "way": result["way"],
            "problem": record["problem"],
            "n": record["n"],
            "H_over_h": result.get("H_over_h", 0),
            "start_cpu": record["start"],
            "peak_mb": record["peak_mb"],
            "iterations": result.get("iterations", np.nan),
            "operations": result.get("operations", np.nan),
            "sets": result.get("sets", np.nan),
            "h1_error": error,
            "over_discrete": error / record.get("reference", np.nan),
            "relative_bound": guarantee.get("relative_bound", np.nan),
            "certify_cpu": guarantee.get("certify_cpu", np.nan),
            **sum_phases(result["phases"]),
        }
        for result, error, guarantee in zip(record["results"], errors, certified, strict=True)
    ]


def sum_phases(phases: Mapping[str, tuple[float, float]]) -> dict[str, float]:
    """Processor seconds of the phases, of all of them, and the wall-clock time of all."""
    seconds = dict.fromkeys(PHASES.values(), 0.0)
    for name, (cpu, _) in phases.items():
        seconds[PHASES[name]] += cpu
    cpu, wall = map(sum, zip(*phases.values(), strict=True))
    return {**seconds, "cpu_seconds": float(cpu), "wall": float(wall)}


def dataset(records: Iterable[Record], machine: Mapping[str, Any]) -> xr.Dataset:
    """The table over `run`, and what the machine can do."""
    return xr.Dataset.from_dataframe(rows(records).rename_axis("run")).assign(machine).drop_vars("run")
