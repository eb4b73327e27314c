"""The benchmarks as documents show them: ratios first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd
import xarray as xr

from benchmarks import ratios as judge
from study.formats import format_value
from unilateral.discrete.choice import MIN_MULTIGRID_UNKNOWNS

SHOWN = (256, 512, 1024)
NAMES = {
    "multigrid": "**this project**, multigrid",
    "further": "the same, each further case or H",
    "recursive newton": "**this project**, recursive elimination, active set",
    "sparse newton": "**this project**, sparse elimination, active set",
    "recursive nesterov": "**this project**, recursive elimination, accelerated Uzawa",
    "recursive uzawa": "**this project**, recursive elimination, plain Uzawa",
    "fenicsx": "FEniCSx, PCMG, active set, nodal",
    "fenicsx_hypre": "FEniCSx, hypre, active set, nodal",
    "snesvi": "FEniCSx, PETSc's SNESVI and hypre, nodal",
    "skfem": "scikit-fem, PyAMG's cycle on the meshes, active set, nodal",
    "skfem_amg": "scikit-fem, PyAMG's Ruge–Stüben, active set, nodal",
    "proximal": "scikit-fem, PyAMG's cycle on the meshes, proximal Galerkin, nodal",
    "ngsolve": "NGSolve, sparse Cholesky, active set, nodal",
    "getfem": "GetFEM, this P1/P0 method, H = 4h",
}
"""All begin on a coarse mesh, and go from mesh to mesh."""
BESIDE = {"fenicsx": "FEniCSx, PCMG", "skfem": "scikit-fem, PyAMG"}
"""The solvers that are run on several problems."""
PHASES = {"start": "start, not counted", "mesh": "mesh", "assembly": "matrices", "solve": "solve"}
COUNTS = {"iterations": "iterations", "sets": "sets or steps"}
PROBLEMS = {
    "natural": "`natural`, contact from 1/2",
    "natural_0437": "`natural`, contact from 0.437",
    "three_zones": "3 contact zones",
    "zones_37": "37 contact zones",
    "thirds": "`thirds`",
    "lshape": "`thirds`, L-shape",
    "slivers": "`natural`, slivers of 3°",
}


def solvers(table: xr.Dataset) -> pd.DataFrame:
    """The seconds from nothing for `natural`, over multigrid's; memory and error on the largest mesh.

    A solver that was not there has no row.
    """
    runs = table.to_dataframe()
    return pd.DataFrame([_solver(runs, way) for way in NAMES if len(judge.along(runs, way))])


def _solver(runs: pd.DataFrame, way: str) -> dict[str, str]:
    levels = judge.along(runs, way)
    ratio = judge.ratios(runs, way)
    row = {"`natural`, H = 2h": NAMES[way]}
    for n in SHOWN:
        cell = "–"
        if n in levels.index:
            seconds = f"{two_digits(levels['cpu_seconds'][n])} s"
            cell = seconds if way == judge.MULTIGRID else f"× {two_digits(ratio[n])} ({seconds})"
        row[f"{format_value((n + 1) ** 2, 'space')} unknowns"] = cell
    last = levels.index[levels.index <= SHOWN[-1]].max()
    size_note = "" if last == SHOWN[-1] else f" (at {format_value((last + 1) ** 2, 'space')})"
    row["peak memory"] = f"{format_value(float(levels['peak_mb'][last]), '.0f')} MB{size_note}"
    row["guaranteed error of u"] = f"{format_bound(levels['relative_bound'][last])}{size_note}"
    return row


def format_bound(relative_bound: float) -> str:
    """A guaranteed error, rounded up, or that `ul.certify` gave none."""
    return format_value(relative_bound, "up.2g%") if math.isfinite(relative_bound) else "none"


def two_digits(value: float) -> str:
    """At least two digits, and no exponent."""
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"


def phases(table: xr.Dataset) -> pd.DataFrame:
    """Seconds of each phase in the middle of the sizes, their spread, iterations; growth over all sizes."""
    runs = table.to_dataframe()
    n = SHOWN[1]
    rows = []
    for way, name in NAMES.items():
        levels = judge.along(runs, way)
        if n in levels.index:
            run = levels.loc[n]
            row = {f"seconds at n = {n}": name} | {
                title: two_digits(run[f"{phase}_cpu"]) for phase, title in PHASES.items()
            }
            row["least to most"] = " to ".join(two_digits(run[f"cpu_{end}"]) for end in ("least", "most"))
            row |= {title: _count(run[column]) for column, title in COUNTS.items()}
            row["`ul.certify`, not counted"] = two_digits(run["certify_cpu"])
            row["p"] = f"{judge.growth(levels['cpu_seconds'].loc[SHOWN[0] :]):.1f}"
            rows.append(row)
    return pd.DataFrame(rows)


def _count(value: float) -> str:
    return "–" if pd.isna(value) else format_value(value, "space")


def problems(table: xr.Dataset) -> pd.DataFrame:
    """Multigrid's iterations and seconds for each problem, and the seconds of others over its own.

    Its seconds are those on the finest mesh shown; the ratios are those on the finest mesh of both.
    """
    runs = table.to_dataframe()
    rows = []
    for problem, name in PROBLEMS.items():
        levels = judge.along(runs, judge.MULTIGRID, problem).loc[: SHOWN[-1]]
        further = judge.along(runs, judge.FURTHER, problem)["cpu_seconds"]
        n = levels.index[-1]
        row = {
            "problem": name,
            "iterations": _span(levels["iterations"]),
            "sets": _span(levels["sets"]),
            "n": str(n),
        }
        row |= {"seconds": two_digits(levels["cpu_seconds"][n]), "each further": two_digits(further[n])}
        row |= {name: _finest_ratio(judge.ratios(runs, way, problem=problem)) for way, name in BESIDE.items()}
        rows.append(row)
    return pd.DataFrame(rows)


def _finest_ratio(ratios: pd.Series) -> str:
    return f"× {two_digits(ratios.iloc[-1])} (n = {ratios.index[-1]})" if len(ratios) else "–"


def _span(counts: pd.Series) -> str:
    smallest = int(counts.min())
    largest = int(counts.max())
    return str(smallest) if smallest == largest else f"{smallest} to {largest}"


def numbers(table: xr.Dataset) -> dict[str, Any]:
    """The machine, times and ratios by way and n, growth, iterations and what of the machine is used."""
    runs = table.to_dataframe()
    n = SHOWN[-1]
    multigrid = judge.along(runs, judge.MULTIGRID)
    counts = judge.iterations(runs, PROBLEMS)
    largest = multigrid.index[-1]
    return {
        **{name: table[name].item() for name in ("date", "processor", "cores")},
        "growth": judge.growth(multigrid["cpu_seconds"].loc[SHOWN[1] :]),
        "grows_from": SHOWN[1],
        "largest": {"n": int(largest), "unknowns": int(largest + 1) ** 2}
        | {name: float(multigrid[name][largest]) for name in ("cpu_seconds", "peak_mb")},
        "pays": MIN_MULTIGRID_UNKNOWNS,
        "worst": float(runs.loc[comparable(runs), "over_discrete"].max() - 1),
        "zones": float((counts["zones_37"] / counts["natural"]).max()),
        "slivers": int(counts["slivers"].max()),
        **_compare_fastest(runs, n),
        "over_linear": float(multigrid["solve_cpu"][n] / judge.along(runs, judge.LINEAR)["solve_cpu"][n]),
        "reads": judge.reads(runs, table, n),
        "certify_cpu": float(multigrid["certify_cpu"][n]),
        "bandwidth": float(table["bandwidth"]) / 1e9,
        "flop_rate": float(table["flop_rate"]) / 1e9,
        "share_of_peak": judge.share_of_peak(runs, table, n),
        "eliminated": _values_at_sizes(judge.ratios(runs, "recursive newton"), 256, 1024),
        "sparse": _values_at_sizes(judge.ratios(runs, "sparse newton"), 256, 512),
        "further_load": _values_at_sizes(
            judge.ratios(runs, "recursive further newton", judge.FURTHER), 256, 1024
        ),
    }


def _compare_fastest(runs: pd.DataFrame, n: int) -> dict[str, Any]:
    """The other solver with the least seconds at n, and with the least in the solve alone.

    Both are ratios to this project's seconds; there is none without other solvers.
    """
    ours = judge.along(runs, judge.MULTIGRID).loc[n]
    levels = {way: judge.along(runs, way) for way in judge.PEERS}
    peers = pd.DataFrame({way: runs_at.loc[n] for way, runs_at in levels.items() if n in runs_at.index}).T
    if peers.empty:
        return {}
    compared = {"fastest": "cpu_seconds", "fastest_solve": "solve_cpu"}
    numbers: dict[str, Any] = {}
    for name, column in compared.items():
        way = peers[column].astype(float).idxmin()
        numbers[name] = {"name": NAMES[str(way)], "ratio": float(peers[column][way] / ours[column])}
    return numbers


def comparable(runs: pd.DataFrame) -> pd.Series:
    """Which runs are to have the errors of the discrete solution on cells of two edges.

    Runs on cells of four edges are left out, and so are those below the first n shown.
    """
    return (runs["H_over_h"] != max(judge.H_OVER_H.values())) & (runs["n"] >= SHOWN[0])


def _values_at_sizes(values: pd.Series, *sizes: int) -> Mapping[str, float]:
    """The values at those of the sizes n at which there are some."""
    return {str(n): float(values[n]) for n in sizes if n in values}
