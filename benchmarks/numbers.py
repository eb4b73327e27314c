"""The benchmarks, other solvers' scores and the times of commands, as documents show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from benchmarks import side_by_side
from benchmarks.side_by_side import NAMES, format_bound, two_digits
from study.formats import format_value
from unilateral.formulas.formula import parse_real

OURS = "unilateral"
LARGE = 1024
"""The name under which this project's commands are listed; the n at which the time of the bound is told."""
PACKAGES = {
    "skfem": "scikit-fem, active set, u ≥ g at the nodes",
    "fenicsx": "FEniCSx, PETSc's SNESVI, u ≥ g at the nodes",
    "ngsolve": "NGSolve, active set, u ≥ g at the nodes",
    "getfem": "GetFEM, augmented Lagrangian, u ≥ g in the mean over cells",
}
RATES = {"h1": "rate of u, ours", "hm12": "rate of λ, ours"}


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """Times, ratios and scores, as documents name them."""
    return {
        "benchmarks": side_by_side.numbers(results["benchmarks/results"]),
        "commands": command_numbers(results["benchmarks/commands"]),
        "trust": trust_numbers(results["benchmarks/trust"]),
        "precision": precision_numbers(results["benchmarks/precision"]),
        "scores": {name: parse_real(results["benchmarks/scores"][name].iloc[0], name) for name in ("h", "H")},
    }


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of solvers, phases, problems, commands, certificates and scores."""
    return {
        "benchmarks": side_by_side.solvers(results["benchmarks/results"]),
        "benchmark-phases": side_by_side.phases(results["benchmarks/results"]),
        "benchmark-problems": side_by_side.problems(results["benchmarks/results"]),
        "commands": commands(results["benchmarks/commands"]),
        "trust": trust(results["benchmarks/trust"]),
        "precision": precision(results["benchmarks/precision"]),
        "scores": scores(results["benchmarks/scores"]),
    }


def command_numbers(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The date, the processor, the bound's seconds over the solve's, and a search's levels over its last.

    Also the driver of another package with the least seconds on the large mesh, over this project's command.
    """
    (bound,) = [row for row in stored["rows"] if row["solver"] == "bound" and row["n"] == LARGE]
    levels = [row["levels_over_last"] for row in stored["rows"] if row["solver"] == OURS and row["n"] == 0]
    return {
        **{name: stored[name] for name in ("date", "processor")},
        **{name: bound[name] for name in ("unknowns", "bound_over_solve")},
        "levels_over_last": max(levels, default=1.0),
        "fastest": _fastest_driver(stored["rows"]),
    }


def _fastest_driver(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Its name, its memory, and its seconds, also with those of `ul.certify`, over those of our command."""
    large = [row for row in rows if row["n"] == LARGE and row["solver"] in NAMES]
    if not large:
        return {}
    fastest = min(large, key=lambda row: row["cpu_seconds"])
    (ours,) = [
        row for row in rows if (row["solver"], row["problem"], row["n"]) == (OURS, fastest["problem"], LARGE)
    ]
    return {
        "name": NAMES[fastest["solver"]],
        "over_ours": fastest["over_ours"],
        "memory_over_ours": fastest["peak_mb"] / ours["peak_mb"],
        "certified_over_ours": (fastest["cpu_seconds"] + fastest["certify_cpu"]) / ours["cpu_seconds"],
    }


def commands(stored: Mapping[str, Any]) -> pd.DataFrame:
    """Costs of whole processes, from the command to the answer: by command, then by other solver and size."""
    return pd.DataFrame(
        [_command(row) for names in ([OURS], NAMES) for row in stored["rows"] if row["solver"] in names]
    )


def _command(row: Mapping[str, Any]) -> dict[str, str]:
    seconds = f"{two_digits(row['cpu_seconds'])} s"
    return {
        "command, or solver": f"`{row['typed']}`" if "typed" in row else NAMES[row["solver"]],
        "unknowns": format_value(row["unknowns"], "space"),
        "processor seconds": seconds,
        "per unknown": f"{two_digits(1e6 * row['cpu_seconds'] / row['unknowns'])} µs",
        "memory": f"{row['peak_mb']:.0f} MB",
        "guaranteed error of u": format_bound(row["relative_bound"]),
        "`ul.certify`": f"{two_digits(row['certify_cpu'])} s" if "certify_cpu" in row else "in the command",
    }


def trust_numbers(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The date, and on the largest mesh what a check takes, also over the bound and the solve before it."""
    largest = stored["rows"][-1]
    ours = largest["solve"]["seconds"] + largest["bound"]["seconds"]
    return {
        "date": stored["date"],
        **{name: largest[name] for name in ("triangles", "file_mb")},
        **largest["check"],
        "over_ours": largest["check"]["seconds"] / ours,
    }


TRUST = {"solve": "solve", "bound": "bound", "certificate": "certificate written"}
TRUST |= {checker: f"`{checker}.py`" for checker in ("check", "check_formulas")}


def trust(stored: Mapping[str, Any]) -> pd.DataFrame:
    """Seconds of a solve, a bound, its certificate and the check, by triangles; more of the largest mesh."""
    table = pd.DataFrame({"part": TRUST.values()})
    for mesh in stored["rows"]:
        seconds = [f"{two_digits(mesh[name]['seconds'])} s" for name in TRUST]
        table[f"{format_value(mesh['triangles'], 'space')} triangles"] = seconds
    largest = stored["rows"][-1]
    table["each"] = [f"{two_digits(1e6 * largest[p]['seconds'] / largest['triangles'])} µs" for p in TRUST]
    return table.assign(memory=[f"{largest[name]['mb']:.0f} MB" for name in TRUST])


def precision_numbers(stored: Mapping[str, Any]) -> dict[str, Any]:
    """The date, the processor, and the least and most unknowns and seconds of ours over those of P2."""
    numbers: dict[str, Any] = {name: stored[name] for name in ("date", "processor")}
    for name in ("unknowns", "cpu_seconds"):
        ratios = [row["ours"][name] / row["p2"][name] for row in stored["rows"]]
        numbers[name] = {"least": min(ratios), "most": max(ratios)}
    return numbers


def precision(stored: Mapping[str, Any]) -> pd.DataFrame:
    """Unknowns and seconds of P2 to an accuracy, and of this project to a certified one."""
    return pd.DataFrame(
        [
            {
                "case": f"`{row['case']}`",
                "error of u in H¹": format_value(row["accuracy"], ".2g%"),
                "P2: unknowns": format_value(row["p2"]["unknowns"], "space"),
                "P2: seconds": two_digits(row["p2"]["cpu_seconds"]),
                "ours: unknowns": format_value(row["ours"]["unknowns"], "space"),
                "ours: seconds": two_digits(row["ours"]["cpu_seconds"]),
                "ours: guaranteed": format_value(row["ours"]["bound"], "up.2g%"),
            }
            for row in stored["rows"]
        ]
    )


def scores(table: pd.DataFrame) -> pd.DataFrame:
    """The scores of other packages' solutions of exported cases.

    A row per case and solver: errors on the finest level over this project's, rates, and the verdict.
    """
    return pd.DataFrame([_score(row) for _, row in table.sort_values("case", kind="stable").iterrows()])


def _score(row: pd.Series) -> dict[str, str]:
    cells = {"case": f"`{row['case']}`", "package and method": PACKAGES[row["solver"]]}
    cells["error of $u$ in $H^1$"] = f"× {row['h1_over_own']:.3f}"
    cells[r"error of $\lambda$ in $H^{-1/2}$"] = f"× {row['hm12_over_own']:.2f}"
    for norm, title in RATES.items():
        cells[title] = f"{row[f'{norm}_rate']:.2f}, {row[f'{norm}_own_rate']:.2f}"
    return cells | {"verdict": row["verdict"]}
