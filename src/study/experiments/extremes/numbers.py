"""The extremes, as documents show them: limits, axes on which there is none, and bounds over c/k."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from study.formats import DASH, format_value

RESCUED = "right, but not by plain Uzawa"
NOWHERE_RIGHT = "none"
TOOL_NOT_OFFERED = "not offered"
KIND_TEXTS = {RESCUED: "by another algorithm only"}
ALLOWANCE_FACTOR = 3
"""The allowance for rounding is told with this factor, since the digits of rounding are not reproducible."""
MAX_SLIGHT_C_OVER_K = 0.01
"""The largest c/k that is compared with c = 0."""
CONDITION_AXES = (
    "odd",
    "shift",
    "short",
    "short_loaded",
    "scale_down",
    "scale_up",
    "angle",
    "slit",
    "side",
    "aspect",
)
"""The axes whose numbers are cond(S)."""


def outcome_kinds(table: xr.Dataset) -> NDArray[np.str_]:
    """Outcome of plain Uzawa at each point (p,), or that only the library's own choice is right."""
    outcome = table["outcome"].values
    tool = table["tool"].values
    return np.where((outcome != "right") & (tool == "right"), RESCUED, outcome)


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """Counts of outcomes, and bounds over c/k, as documents name them."""
    return {
        "extremes": summarise_outcomes(results["extremes/extremes"]),
        "reaction": summarise_reaction(results["extremes/reaction"]),
    }


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of axes with limits and without."""
    return {
        "extremes-limits": tabulate_limits(results["extremes/extremes"]),
        "extremes-unlimited": tabulate_unlimited_axes(results["extremes/extremes"]),
    }


def tabulate_limits(table: xr.Dataset) -> pd.DataFrame:
    """Per axis its range, the limits of plain Uzawa and of `unilateral solve`, and the outcomes.

    Axes without limits on which all is right are left out; `tabulate_unlimited_axes` has them.
    """
    rows = []
    for name in [axis for axis in table["axis"].values if axis not in unlimited_axes(table)]:
        axis_limits = table.sel(axis=name)
        points = table["axis_of"].values == name
        tooled = np.all(table["tool"].values[points] != "")
        count = Counter(outcome_kinds(table)[points].tolist())
        row = _describe_axis(table, name)
        row["limit of plain Uzawa: predicted, met at"] = _format_limits(axis_limits, "limit")
        row["limit of `unilateral solve`: predicted, met at"] = (
            _format_limits(axis_limits, "tool_limit") if tooled else TOOL_NOT_OFFERED
        )
        row["points"] = ", ".join(f"{many} {KIND_TEXTS.get(kind, kind)}" for kind, many in count.items())
        rows.append(row)
    return pd.DataFrame(rows)


def tabulate_unlimited_axes(table: xr.Dataset) -> pd.DataFrame:
    """The axes without limits, and their ranges."""
    return pd.DataFrame([_describe_axis(table, name) for name in unlimited_axes(table)])


def unlimited_axes(table: xr.Dataset) -> list[str]:
    """The axes for which no limit is predicted, and on which plain Uzawa is right everywhere."""
    limit_names = ("predicted_limit", "predicted_tool_limit", "measured_limit")
    is_unlimited = np.all([np.isnan(table[name].values) for name in limit_names], axis=0)
    return [str(name) for name in table["axis"].values[is_unlimited]]


def _describe_axis(table: xr.Dataset, name: str) -> dict[str, str]:
    values = table["value"].values[table["axis_of"].values == name]
    ends = (format_value(values[k], "short") for k in (0, -1))
    return {"axis": table["label"].sel(axis=name).item(), "from mild to extreme": " … ".join(ends)}


def _format_limits(axis_limits: xr.Dataset, limit_name: str) -> str:
    limits = (float(axis_limits[f"{which}_{limit_name}"]) for which in ("predicted", "measured"))
    return ", ".join(
        NOWHERE_RIGHT if math.isinf(x) else DASH if math.isnan(x) else format_value(x, "short")
        for x in limits
    )


def summarise_outcomes(table: xr.Dataset) -> dict[str, Any]:
    """How many points there are, what became of them, what rounding explains, how far rho may go."""
    count = Counter(outcome_kinds(table).tolist())
    solved = table["u_norm"].values > 0
    share = (table["allowance"] / table["u_norm"]).values[solved]
    over_law = (table["measured"] / table["predicted"]).values[
        np.isin(table["axis_of"].values, CONDITION_AXES)
    ]
    return {
        "points": table.sizes["point"],
        "axes": {"all": table.sizes["axis"], "unlimited": len(unlimited_axes(table))},
        **{name: count[name.replace("_", " ")] for name in ("right", "not_converged", "refused", "wrong")},
        "by_tool": count[RESCUED],
        "allowed": 10.0 ** math.ceil(math.log10(ALLOWANCE_FACTOR * np.max(share))),
        "cond_over_law": float(np.max(over_law[np.isfinite(over_law)])),
        "partial": {
            "step": _bracket_limit(table, "step_partial"),
            "printed": _bracket_limit(table, "printed_partial"),
        },
    }


def _bracket_limit(table: xr.Dataset, axis: str) -> dict[str, Any]:
    """The last value before the first that is not right, that one, and the local limit."""
    axis_limits = table.sel(axis=axis)
    values = table["value"].values[table["axis_of"].values == axis]
    first = float(axis_limits["measured_limit"])
    local = float(axis_limits["local_limit"])
    return {"right": float(values[values < first].max()), "fails": first, "local": local}


def summarise_reaction(table: xr.Dataset) -> dict[str, Any]:
    """Points over c/k, the largest bounds over the error, and the relative change that a slight c makes.

    `slight` is how far the error, or a bound over it, is for 0 < c/k <= 0.01 from that of c = 0, relatively.
    """
    values = table["c_over_k"].values
    sizes = table["h"].values
    error = table["energy_error"]
    index = {bound: table[f"{bound}_bound"] / error for bound in ("cheap", "sharp")}
    slight = (table["c_over_k"] > 0) & (table["c_over_k"] <= MAX_SLIGHT_C_OVER_K)
    changes = [abs(ratio / ratio.sel(c_over_k=0) - 1).where(slight) for ratio in (error, *index.values())]
    return {
        "points": int(error.size),
        "failed": int(np.count_nonzero(np.isnan(error))),
        "from": float(values[values > 0].min()),
        "to": float(values.max()),
        "coarsest": float(sizes.max()),
        "finest": float(sizes.min()),
        **{bound: float(ratio.max()) for bound, ratio in index.items()},
        "slight": max(float(change.max()) for change in changes),
    }
