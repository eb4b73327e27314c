"""Where the method, the algorithm and this code break: axes of extreme problems, each point judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import xarray as xr

from study import registry, tables
from study.experiments.extremes import cells, contact, iteration, shapes
from study.experiments.extremes.outcome import NO_TOOL, RIGHT, Axis, Budget, Row
from unilateral.formulas.formula import real

MODULES = {each.__name__.rpartition(".")[2]: each for each in (cells, contact, iteration, shapes)}
KINDS = {name: getattr(MODULES[module], name) for name, module in registry.axes().items()}
"""The function of each kind of axis."""


def try_extremes(study: Mapping[str, Any], extremes: str) -> None:
    """Write the table of all axes."""
    h, H = (real(study[name], f"extremes.{name}") for name in ("h", "H"))
    budget = Budget(study["accuracy"], study["max_steps"])
    tables.save(survey(study["axes"], h, H, budget), extremes, "extremes", {"extremes": study})


def survey(axes: Mapping[str, Mapping[str, Any]], h: float, H: float, budget: Budget) -> xr.Dataset:
    """The axes' points, in the order of their values, from mild to extreme; see variables.yaml.

    Limits are predicted as values up to which all is right (NaN: everywhere; inf: nowhere), and measured as
    the first one that is not.
    """
    surveyed = {name: _axis(name, axis, h, H, budget) for name, axis in axes.items()}
    points = [(name, row) for name, axis in surveyed.items() for row in axis.rows]
    table: dict[str, Any] = {"axis_of": ("point", [name for name, _ in points])}
    for column in fields(Row):
        table[column.name] = "point", [getattr(row, column.name) for _, row in points]
    of_axis = {
        "label": [axis["label"] for axis in axes.values()],
        "predicted_limit": [axis.limit for axis in surveyed.values()],
        "predicted_tool_limit": [axis.tool_limit for axis in surveyed.values()],
        "local_limit": [axis.local_limit for axis in surveyed.values()],
        "measured_limit": [_first(axis.rows, "outcome") for axis in surveyed.values()],
        "measured_tool_limit": [_first(axis.rows, "tool") for axis in surveyed.values()],
    }
    table |= {name: ("axis", values) for name, values in of_axis.items()}
    return xr.Dataset(table, coords={"axis": list(axes)})


def _axis(name: str, axis: Mapping[str, Any], h: float, H: float, budget: Budget) -> Axis:
    where = f"extremes.axes.{name}"
    values = np.array([_value(value, where) for value in axis["values"]])
    h, H = real(axis.get("h", h), where), real(axis.get("H", H), where)
    allowed = Budget(real(axis.get("accuracy", budget.accuracy), where), budget.max_steps)
    judged: Axis = KINDS[axis["kind"]](values, h, H, allowed)
    return judged


def _value(value: object, where: str) -> float:
    """A number as it is, or the value of a fraction; the grammar of formulas has no numbers beyond 1e301."""
    return value if isinstance(value, float) else real(value, where)


def _first(rows: Sequence[Row], what: str) -> float:
    broken = [row.value for row in rows if getattr(row, what) not in (RIGHT, NO_TOOL)]
    return broken[0] if broken else np.nan
