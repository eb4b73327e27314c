"""The benchmarks, other solvers' scores and the times of commands, as documents show them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from unilateral.formulas.formula import real
from unilateral.study.experiments.benchmarks import commands, scores, side_by_side

READS = {
    "results": "benchmarks/results.nc",
    "scores": "benchmarks/scores.csv",
    "commands": "benchmarks/commands.json",
}
"""The files behind the numbers and tables of this experiment in documents, by name."""


def numbers(of: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "benchmarks": side_by_side.numbers(of["results"]),
        "commands": commands.numbers(of["commands"]),
        "scores": {name: real(of["scores"][name].iloc[0], name) for name in ("h", "H")},
    }


def blocks(of: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    return {
        "benchmarks": side_by_side.solvers(of["results"]),
        "benchmark-phases": side_by_side.phases(of["results"]),
        "benchmark-problems": side_by_side.problems(of["results"]),
        "commands": commands.table(of["commands"]),
        "scores": scores.solvers(of["scores"]),
    }
