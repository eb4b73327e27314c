"""The extremes, as documents show them: limits, and axes on which there is none."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.study.experiments.extremes.kinds import RESCUED, kinds
from unilateral.study.formats import shown

ALWAYS, NEVER, NO_TOOL = "–", "none", "not offered"
TOLD = {RESCUED: "by another algorithm only"}


def limits(table: xr.Dataset) -> pd.DataFrame:
    """Per axis its range, the limits of plain Uzawa and of `unilateral solve`, and the outcomes.

    Axes without limits on which all is right are left out; `unlimited` has them.
    """
    rows = []
    for name in [each for each in table["axis"].values if each not in dull(table)]:
        of, points = table.sel(axis=name), table["axis_of"].values == name
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
