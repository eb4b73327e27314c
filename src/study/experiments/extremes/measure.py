"""Where the method, the algorithm and this code break: axes of extreme problems, each point judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from study import tables
from study.experiments.extremes import data_axes, mesh_axes
from study.experiments.extremes.neighbours import survey_neighbours
from study.experiments.extremes.outcome import OUTCOME_NO_TOOL, OUTCOME_RIGHT, Axis, Budget, try_value
from study.experiments.extremes.reaction import survey_reaction
from unilateral.arrays import Array
from unilateral.formulas.formula import parse_real

AXES: dict[str, Callable[[Array, float, float, Budget], Axis]] = {
    "ratio": mesh_axes.ratio_axis,
    "odd": mesh_axes.odd_edges_axis,
    "shift": mesh_axes.shifted_cells_axis,
    "short": mesh_axes.short_cell_axis,
    "short_loaded": mesh_axes.loaded_short_cell_axis,
    "near": mesh_axes.near_vertices_axis,
    "kernel": mesh_axes.kernel_axis,
    "kernel_loaded": mesh_axes.loaded_kernel_axis,
    "data_down": data_axes.data_size_axis,
    "data_up": data_axes.data_size_axis,
    "start": data_axes.start_size_axis,
    "flat": data_axes.flat_contact_axis,
    "touching": data_axes.touching_axis,
    "shrinking": data_axes.shrinking_contact_axis,
    "vertex": data_axes.vertex_contact_axis,
    "nothing": data_axes.zero_data_axis,
    "scale_down": mesh_axes.square_size_axis,
    "scale_up": mesh_axes.square_size_axis,
    "moved": mesh_axes.square_place_axis,
    "angle": mesh_axes.needle_angle_axis,
    "slit": mesh_axes.slit_width_axis,
    "side": mesh_axes.short_side_axis,
    "aspect": mesh_axes.aspect_ratio_axis,
    "step_full": data_axes.full_step_axis,
    "step_partial": data_axes.partial_step_axis,
    "printed_full": data_axes.full_printed_axis,
    "printed_partial": data_axes.partial_printed_axis,
    "single": data_axes.single_precision_axis,
    "double": data_axes.double_precision_axis,
}
"""The axes: functions of the values, h, H and the budget of a run."""


def try_extremes(study: Mapping[str, Any], extremes: str, reaction: str, neighbours: str) -> None:
    """Write the tables of all axes, of errors and bounds over c/k, and of the work at neighbouring sizes."""
    tables.save_table(survey_axes(study), extremes, "extremes", {"extremes": study})
    tables.save_table(survey_reaction(study["reaction"]), reaction, "extremes", {"extremes": study})
    tables.save_table(survey_neighbours(study), neighbours, "extremes", {"extremes": study})


def survey_axes(study: Mapping[str, Any]) -> xr.Dataset:
    """The axes' points, in the order of their values, from mild to extreme; see variables.yaml.

    Limits are predicted as values up to which all is right (NaN: everywhere; inf: nowhere), and measured as
    the first one that is not.
    """
    points: list[dict[str, Any]] = []
    limits: list[dict[str, Any]] = []
    for name, declared in study["axes"].items():
        axis, tried = _try_axis(name, study | declared)
        points += [{"axis_of": name, **point} for point in tried]
        limits.append(
            {
                "label": declared["label"],
                "predicted_limit": axis.limit,
                "predicted_tool_limit": axis.tool_limit,
                "local_limit": axis.local_limit,
                "measured_limit": _first_failing_value(tried, "outcome"),
                "measured_tool_limit": _first_failing_value(tried, "tool"),
            }
        )
    table = {name: ("point", [point[name] for point in points]) for name in points[0]}
    table |= {name: ("axis", [limit[name] for limit in limits]) for name in limits[0]}
    return xr.Dataset(table, coords={"axis": list(study["axes"])})


def _try_axis(name: str, declared: Mapping[str, Any]) -> tuple[Axis, list[dict[str, Any]]]:
    """The axis of that name and the outcome of each value; `declared` has its sizes and its budget."""
    field = f"extremes.axes.{name}"
    values = np.array([read_value(value, field) for value in declared["values"]])
    h = parse_real(declared["h"], field)
    H = parse_real(declared["H"], field)
    budget = Budget(parse_real(declared["accuracy"], field), declared["max_steps"])
    axis = AXES[name](values, h, H, budget)
    predicted = np.broadcast_to(axis.predicted, values.shape)
    tried = [
        try_value(axis, value, number, budget)
        for value, number in zip(values.tolist(), predicted.tolist(), strict=True)
    ]
    return axis, tried


def read_value(value: object, field: str) -> float:
    """A number as it is, or the value of a fraction; the grammar of formulas has no numbers beyond 1e301."""
    return value if isinstance(value, float) else parse_real(value, field)


def _first_failing_value(points: Sequence[Mapping[str, Any]], outcome_name: str) -> float:
    """The first value whose outcome, or that of the library's choice, is not right; NaN if there is none."""
    broken = [
        point["value"] for point in points if point[outcome_name] not in (OUTCOME_RIGHT, OUTCOME_NO_TOOL)
    ]
    return broken[0] if broken else np.nan
