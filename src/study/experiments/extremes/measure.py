"""Where the method, the algorithm and this code break: axes of extreme problems, each point judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from study import tables
from study.experiments.extremes import data_axes, mesh_axes
from study.experiments.extremes.outcome import NO_TOOL, RIGHT, Axis, Budget, try_value
from study.experiments.extremes.reaction import survey_reaction
from unilateral.arrays import Array
from unilateral.formulas.formula import real

AXES: dict[str, Callable[[Array, float, float, Budget], Axis]] = {
    "ratio": mesh_axes.ratio,
    "odd": mesh_axes.odd,
    "shift": mesh_axes.shift,
    "short": mesh_axes.short,
    "short_loaded": mesh_axes.short_loaded,
    "near": mesh_axes.near,
    "kernel": mesh_axes.kernel,
    "kernel_loaded": mesh_axes.kernel_loaded,
    "data_down": data_axes.data,
    "data_up": data_axes.data,
    "start": data_axes.start,
    "flat": data_axes.flat,
    "touching": data_axes.touching,
    "shrinking": data_axes.shrinking,
    "vertex": data_axes.vertex,
    "nothing": data_axes.nothing,
    "scale_down": mesh_axes.scaled,
    "scale_up": mesh_axes.scaled,
    "moved": mesh_axes.moved,
    "angle": mesh_axes.angle,
    "slit": mesh_axes.slit,
    "side": mesh_axes.side,
    "aspect": mesh_axes.aspect,
    "step_full": data_axes.step_full,
    "step_partial": data_axes.step_partial,
    "printed_full": data_axes.printed_full,
    "printed_partial": data_axes.printed_partial,
    "single": data_axes.single,
    "double": data_axes.double,
}
"""The axes: functions of the values, h, H and the budget of a run."""


def try_extremes(study: Mapping[str, Any], extremes: str, reaction: str) -> None:
    """Write the table of all axes, and that of the errors and bounds over c/k."""
    tables.save(survey(study), extremes, "extremes", {"extremes": study})
    tables.save(survey_reaction(study["reaction"]), reaction, "extremes", {"extremes": study})


def survey(study: Mapping[str, Any]) -> xr.Dataset:
    """The axes' points, in the order of their values, from mild to extreme; see variables.yaml.

    Limits are predicted as values up to which all is right (NaN: everywhere; inf: nowhere), and measured as
    the first one that is not.
    """
    points: list[dict[str, Any]] = []
    limits: list[dict[str, Any]] = []
    for name, declared in study["axes"].items():
        field = f"extremes.axes.{name}"
        values = np.array([read_value(value, field) for value in declared["values"]])
        h = real(declared.get("h", study["h"]), field)
        H = real(declared.get("H", study["H"]), field)
        accuracy = real(declared.get("accuracy", study["accuracy"]), field)
        budget = Budget(accuracy, study["max_steps"])
        axis = AXES[name](values, h, H, budget)
        predicted = np.broadcast_to(axis.predicted, values.shape)
        tried = [
            try_value(axis, value, number, budget)
            for value, number in zip(values.tolist(), predicted.tolist(), strict=True)
        ]
        points += [{"axis_of": name, **point} for point in tried]
        limits.append(
            {
                "label": declared["label"],
                "predicted_limit": axis.limit,
                "predicted_tool_limit": axis.tool_limit,
                "local_limit": axis.local_limit,
                "measured_limit": _first_broken(tried, "outcome"),
                "measured_tool_limit": _first_broken(tried, "tool"),
            }
        )
    table = {name: ("point", [point[name] for point in points]) for name in points[0]}
    table |= {name: ("axis", [limit[name] for limit in limits]) for name in limits[0]}
    return xr.Dataset(table, coords={"axis": list(study["axes"])})


def read_value(value: object, field: str) -> float:
    """A number as it is, or the value of a fraction; the grammar of formulas has no numbers beyond 1e301."""
    return value if isinstance(value, float) else real(value, field)


def _first_broken(points: Sequence[Mapping[str, Any]], which: str) -> float:
    """The first value whose outcome, or that of the library's choice, is not right; NaN if there is none."""
    broken = [point["value"] for point in points if point[which] not in (RIGHT, NO_TOOL)]
    return broken[0] if broken else np.nan
