"""The rows of the figure "where it breaks"."""

from __future__ import annotations

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

RESCUED = "right, but not by plain Uzawa"


def frame(table: xr.Dataset) -> pd.DataFrame:
    """A row per point: the axis's label, the kind of outcome, logarithms of the value and the limits."""
    of = table.sel(axis=table["axis_of"])
    limit, tool_limit = (
        of[name].where(np.isfinite(of[name])) for name in ("predicted_limit", "predicted_tool_limit")
    )
    return pd.DataFrame(
        {
            "label": of["label"].values,
            "kind": kinds(table),
            "log10_value": np.log10(table["value"].values),
            "log10_limit": np.log10(limit.values),
            "log10_tool_limit": np.log10(tool_limit.values),
        }
    )


def kinds(table: xr.Dataset) -> NDArray[np.str_]:
    """(point,) what came of it, by plain Uzawa and by the tool."""
    outcome, tool = table["outcome"].values, table["tool"].values
    return np.where((outcome != "right") & (tool == "right"), RESCUED, outcome)
