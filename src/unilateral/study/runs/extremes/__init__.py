"""Where the method, the algorithm and this code break: axes of extreme problems, each point judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from unilateral.formulas.formula import real
from unilateral.study import functions
from unilateral.study.runs.extremes import cells, contact, precision, shapes, steps
from unilateral.study.runs.extremes.outcome import NO_TOOL, RIGHT, Axis, Budget

__all__ = ["Budget", "joined", "survey"]
MODULES = {each.__name__.rpartition(".")[2]: each for each in (cells, contact, precision, shapes, steps)}
KINDS = {name: getattr(MODULES[module], name) for name, module in functions.axes().items()}
"""The function of each kind of axis."""


def survey(axes: Mapping[str, Mapping[str, Any]], h: float, H: float, budget: Budget) -> xr.Dataset:
    """The axes' points, in the order of their values, from mild to extreme; see variables.yaml.

    Limits are predicted as values up to which all is right (NaN: everywhere; inf: nowhere), and measured as
    the first one that is not.
    """
    points, limits = [], []
    for name, axis in axes.items():
        found = _axis(name, axis, h, H, budget)
        of_points = [row.record() for row in found.rows]
        points += [{"axis_of": name, **record} for record in of_points]
        told = {key: value for key, value in vars(found).items() if key != "rows"}
        measured = [_first(of_points, what) for what in ("outcome", "tool")]
        met = dict(zip(("measured_limit", "measured_tool_limit"), measured, strict=True))
        limits.append({"label": axis["label"], **told, **met})
    table = {name: ("point", [record[name] for record in points]) for name in points[0]}
    table |= {name: ("axis", [record[name] for record in limits]) for name in limits[0]}
    return xr.Dataset(table, coords={"axis": list(axes)})


def _axis(name: str, axis: Mapping[str, Any], h: float, H: float, budget: Budget) -> Axis:
    where = f"extremes.axes.{name}"
    values = np.array([_value(value, where) for value in axis["values"]])
    h, H = real(axis.get("h", h), where), real(axis.get("H", H), where)
    allowed = Budget(real(axis.get("accuracy", budget.accuracy), where), budget.max_steps)
    return KINDS[axis["kind"]](values, h, H, allowed)


def _value(value: object, where: str) -> float:
    """A number as it is, for the grammar of formulas has none beyond 1e301, or a fraction."""
    return value if isinstance(value, float) else real(value, where)


def _first(points: Sequence[Mapping[str, Any]], what: str) -> float:
    broken = [point["value"] for point in points if point[what] not in (RIGHT, NO_TOOL)]
    return broken[0] if broken else np.nan


def joined(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """One table of the axes of several."""
    parts = [part.drop_encoding() for part in parts]
    points = xr.concat([part.drop_dims("axis") for part in parts], "point")
    return xr.merge([points, xr.concat([part.drop_dims("point") for part in parts], "axis")])
