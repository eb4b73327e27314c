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

from study.formats import shown

RESCUED = "right, but not by plain Uzawa"
ALWAYS = "–"
NEVER = "none"
NO_TOOL = "not offered"
TOLD = {RESCUED: "by another algorithm only"}
SPARE = 3
"""The allowance for rounding is told with this factor, since the digits of rounding are not reproducible."""
SLIGHT = 0.01
"""The largest c/k that is compared with c = 0."""
LAWS = ("odd", "shift", "short", "short_loaded", "scale_down", "scale_up", "angle", "slit", "side", "aspect")
"""The axes whose numbers are cond(S)."""


def kinds(table: xr.Dataset) -> NDArray[np.str_]:
    """(point,) the outcome of plain Uzawa, or that the library's own choice is right where that is not."""
    outcome = table["outcome"].values
    tool = table["tool"].values
    return np.where((outcome != "right") & (tool == "right"), RESCUED, outcome)


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "extremes": outcomes(results["extremes/extremes"]),
        "reaction": reaction(results["extremes/reaction"]),
    }


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    return {
        "extremes-limits": limits(results["extremes/extremes"]),
        "extremes-unlimited": unlimited(results["extremes/extremes"]),
    }


def limits(table: xr.Dataset) -> pd.DataFrame:
    """Per axis its range, the limits of plain Uzawa and of `unilateral solve`, and the outcomes.

    Axes without limits on which all is right are left out; `unlimited` has them.
    """
    rows = []
    for name in [each for each in table["axis"].values if each not in dull(table)]:
        of = table.sel(axis=name)
        points = table["axis_of"].values == name
        tooled = np.all(table["tool"].values[points] != "")
        count = Counter(kinds(table)[points].tolist())
        row = _axis(table, name)
        row["limit of plain Uzawa: predicted, met at"] = _limits(of, "limit")
        row["limit of `unilateral solve`: predicted, met at"] = (
            _limits(of, "tool_limit") if tooled else NO_TOOL
        )
        row["points"] = ", ".join(f"{many} {TOLD.get(kind, kind)}" for kind, many in count.items())
        rows.append(row)
    return pd.DataFrame(rows)


def unlimited(table: xr.Dataset) -> pd.DataFrame:
    """The axes without limits, and their ranges."""
    return pd.DataFrame([_axis(table, name) for name in dull(table)])


def dull(table: xr.Dataset) -> list[str]:
    """The axes for which no limit is predicted, and on which plain Uzawa is right everywhere."""
    found = ("predicted_limit", "predicted_tool_limit", "measured_limit")
    none = np.all([np.isnan(table[name].values) for name in found], axis=0)
    return [str(name) for name in table["axis"].values[none]]


def _axis(table: xr.Dataset, name: str) -> dict[str, str]:
    values = table["value"].values[table["axis_of"].values == name]
    ends = (shown(values[k], "short") for k in (0, -1))
    return {"axis": table["label"].sel(axis=name).item(), "from mild to extreme": " … ".join(ends)}


def _limits(of: xr.Dataset, what: str) -> str:
    found = (float(of[f"{which}_{what}"]) for which in ("predicted", "measured"))
    return ", ".join(
        NEVER if math.isinf(x) else ALWAYS if math.isnan(x) else shown(x, "short") for x in found
    )


def outcomes(table: xr.Dataset) -> dict[str, Any]:
    """How many points there are, what became of them, what rounding explains, how far rho may go."""
    count = Counter(kinds(table).tolist())
    solved = table["u_norm"].values > 0
    share = (table["allowance"] / table["u_norm"]).values[solved]
    over_law = (table["measured"] / table["predicted"]).values[np.isin(table["axis_of"].values, LAWS)]
    return {
        "points": table.sizes["point"],
        "axes": {"all": table.sizes["axis"], "unlimited": len(dull(table))},
        **{name: count[name.replace("_", " ")] for name in ("right", "not_converged", "refused", "wrong")},
        "by_tool": count[RESCUED],
        "allowed": 10.0 ** math.ceil(math.log10(SPARE * np.max(share))),
        "cond_over_law": float(np.max(over_law[np.isfinite(over_law)])),
        "partial": {
            "step": _last_and_first(table, "step_partial"),
            "printed": _last_and_first(table, "printed_partial"),
        },
    }


def _last_and_first(table: xr.Dataset, axis: str) -> dict[str, Any]:
    """The last value before the first that is not right, that one, and the local limit."""
    of = table.sel(axis=axis)
    values = table["value"].values[table["axis_of"].values == axis]
    first = float(of["measured_limit"])
    return {"right": float(values[values < first].max()), "fails": first, "local": float(of["local_limit"])}


def reaction(table: xr.Dataset) -> dict[str, Any]:
    """What is tried over c/k, the largest bounds over the error, and what a slight c changes.

    `slight` is how far the error, or a bound over it, is for c/k <= SLIGHT from that of c = 0, relatively.
    """
    values = table["c_over_k"].values
    sizes = table["h"].values
    error = table["energy_error"]
    index = {bound: table[f"{bound}_bound"] / error for bound in ("cheap", "sharp")}
    slight = (table["c_over_k"] > 0) & (table["c_over_k"] <= SLIGHT)
    changes = [abs(each / each.sel(c_over_k=0) - 1).where(slight) for each in (error, *index.values())]
    return {
        "points": int(error.size),
        "failed": int(np.count_nonzero(np.isnan(error))),
        "from": float(values[values > 0].min()),
        "to": float(values.max()),
        "coarsest": float(sizes.max()),
        "finest": float(sizes.min()),
        **{bound: float(each.max()) for bound, each in index.items()},
        "slight": max(float(change.max()) for change in changes),
    }
