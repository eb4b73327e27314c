"""What the table of the benchmarks says: ratios of times, growth, and how near to the machine's limits."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pandas as pd
import xarray as xr

NODAL = 0
"""The H/h of solvers that have no cells."""
MULTIGRID = "multigrid"
FURTHER = "further"
LINEAR = "linear"
PEERS = ("fenicsx", "fenicsx_hypre", "snesvi", "skfem", "skfem_amg", "proximal", "ngsolve")
"""The other solvers with nodal constraints; GetFEM has this very method, on cells of four edges."""
H_OVER_H = {FURTHER: 4, "getfem": 4, LINEAR: NODAL} | dict.fromkeys(PEERS, NODAL)
"""The H/h of what is compared; it is 2 where none is listed."""
ROW_BYTES = 7 * (8 + 4) + 4
"""The bytes of a row of A: seven entries with their columns, and where the row starts."""


def along(
    runs: pd.DataFrame, way: str, problem: str = "natural", H_over_h: int | None = None
) -> pd.DataFrame:
    """The runs of one way to solve, by increasing n."""
    H = H_OVER_H.get(way, 2) if H_over_h is None else H_over_h
    chosen = (runs["way"] == way) & (runs["problem"] == problem) & (runs["H_over_h"] == H)
    return runs[chosen].set_index("n").sort_index()


def ratios(runs: pd.DataFrame, way: str, reference: str = MULTIGRID, problem: str = "natural") -> pd.Series:
    """Seconds of a way over those of another one, over n where both were measured."""
    seconds = along(runs, way, problem)["cpu_seconds"]
    return (seconds / along(runs, reference, problem)["cpu_seconds"]).dropna()


def growth(seconds: pd.Series) -> float:
    """p of seconds ~ n^p, between the first and the last n."""
    first = seconds.index[0]
    last = seconds.index[-1]
    return math.log(seconds[last] / seconds[first]) / math.log(last / first)


def reads(runs: pd.DataFrame, table: xr.Dataset, n: int) -> float:
    """How often A could be read at the memory's bandwidth during a linear multigrid solve."""
    size = ROW_BYTES * (n + 1) ** 2
    return float(along(runs, LINEAR)["solve_cpu"][n] * table["bandwidth"] / size)


def share_of_peak(runs: pd.DataFrame, table: xr.Dataset, n: int) -> float:
    """The share of the machine's dense arithmetic that the elimination by macro-elements reaches."""
    run = along(runs, "recursive uzawa").loc[n]
    return float(run["operations"] / run["assembly_cpu"] / table["flop_rate"])


def iterations(runs: pd.DataFrame, problems: Iterable[str]) -> pd.DataFrame:
    """Multigrid's iterations on the finest level, over n, with a column for each problem."""
    return pd.DataFrame({name: along(runs, MULTIGRID, name)["iterations"] for name in problems})


def predict_multigrid_cost(runs: pd.DataFrame, algorithm: str) -> pd.DataFrame:
    """Predicted cost of an algorithm on the boundary if each of its steps were one linear multigrid solve."""
    steps = along(runs, f"recursive {algorithm}")
    linear = along(runs, LINEAR)
    predicted = linear.loc[linear.index.intersection(steps.index)].copy()
    # Matrices once, and a linear solve in each of the steps that were counted on the boundary
    predicted["cpu_seconds"] = predicted["assembly_cpu"] + steps["iterations"] * predicted["solve_cpu"]
    predicted["h1_error"] = steps["h1_error"]
    return predicted
