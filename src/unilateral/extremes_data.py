"""The extremes for readers: the rows of the figure "where it breaks", and a Markdown table of limits."""

from __future__ import annotations

import textwrap
from collections import Counter

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

RESCUED = "right, but not by plain Uzawa"
ALWAYS = "–"
LINE = 118


def frame(table: xr.Dataset) -> pd.DataFrame:
    """A row per point: the axis's label, the kind of outcome, logarithms of the value and the limits."""
    of = table.sel(axis=table["axis_of"])
    return pd.DataFrame(
        {
            "label": of["label"].values,
            "kind": _kinds(table),
            "log10_value": np.log10(table["value"].values),
            "log10_limit": np.log10(of["predicted_limit"].values),
            "log10_tool_limit": np.log10(of["predicted_tool_limit"].values),
        }
    )


def _kinds(table: xr.Dataset) -> NDArray[np.str_]:
    """(point,) what came of it, by plain Uzawa and by the tool."""
    outcome, tool = table["outcome"].values, table["tool"].values
    return np.where((outcome == "not converged") & (tool == "right"), RESCUED, outcome)


def limits_table(table: xr.Dataset) -> str:
    """Markdown: per axis its range, the limits of plain Uzawa and of the tool, and the outcomes."""
    lines = [
        "| axis | from mild to extreme | limit of plain Uzawa: predicted, met at "
        "| limit of the tool: predicted, met at | points |",
        "|---|---|---|---|---|",
    ]
    kinds = _kinds(table)
    for name in table["axis"].values:
        of, points = table.sel(axis=name), table["axis_of"].values == name
        values = table["value"].values[points]
        cells = [
            str(of["label"].item()),
            f"{_number(values[0])} … {_number(values[-1])}",
            f"{_limit(of['predicted_limit'])}, {_limit(of['measured_limit'])}",
            f"{_limit(of['predicted_tool_limit'])}, {_limit(of['measured_tool_limit'])}",
            ", ".join(f"{count} {kind}" for kind, count in Counter(kinds[points].tolist()).items()),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines).replace(RESCUED, "by the tool only")


def sentences(table: xr.Dataset) -> str:
    """How many points there are, and what became of them."""
    count = Counter(_kinds(table).tolist())
    text = (
        f"Of {table.sizes['point']} points on {table.sizes['axis']} axes {count['right']} are right by plain "
        f"Uzawa and {count[RESCUED]} more by what the tool takes in its place, Nesterov's acceleration or an "
        f"active set; {count['not converged']} end without convergence and with a valid bound, "
        f"{count['refused']} are refused with a message, and {count['wrong']} are wrong."
    )
    return textwrap.fill(text, LINE)


def _limit(value: xr.DataArray) -> str:
    return ALWAYS if np.isnan(value) else _number(float(value))


def _number(value: float) -> str:
    return f"{value:.3g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
