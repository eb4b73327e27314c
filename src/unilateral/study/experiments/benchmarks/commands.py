"""What whole processes take, from the command to the answer, as documents show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from unilateral.study.experiments.benchmarks.side_by_side import NAMES, two_digits
from unilateral.study.formats import shown

OURS, LARGE = "unilateral", 1024
"""The name under which this project's commands are listed; the n at which the time of the bound is told."""


def table(told: Mapping[str, Any]) -> pd.DataFrame:
    """A row per command, then one per other solver and size, with the ratio to the command's seconds."""
    return pd.DataFrame(
        [_row(row) for names in ([OURS], NAMES) for row in told["rows"] if row["solver"] in names]
    )


def _row(row: Mapping[str, Any]) -> dict[str, str]:
    seconds = f"{two_digits(row['cpu_seconds'])} s"
    if row["solver"] != OURS and "over_ours" in row:
        seconds = f"× {two_digits(row['over_ours'])} ({seconds})"
    return {
        "command, or solver": f"`{row['typed']}`" if "typed" in row else NAMES[row["solver"]],
        "unknowns": shown(row["unknowns"], "space"),
        "processor seconds": seconds,
        "per unknown": f"{two_digits(1e6 * row['cpu_seconds'] / row['unknowns'])} µs",
        "memory": f"{row['peak_mb']:.0f} MB",
        "guaranteed error of u": shown(row["relative_bound"], "up.2g%") if "relative_bound" in row else "–",
    }


def numbers(told: Mapping[str, Any]) -> dict[str, Any]:
    """The date, the processor, the bound's seconds over the solve's, and a search's levels over its last."""
    (bound,) = [row for row in told["rows"] if row["solver"] == "bound" and row["n"] == LARGE]
    levels = [row["levels_over_last"] for row in told["rows"] if row["solver"] == OURS and row["n"] == 0]
    return {
        **{name: told[name] for name in ("date", "processor")},
        **{name: bound[name] for name in ("unknowns", "bound_over_solve")},
        "levels_over_last": max(levels, default=1.0),
    }
