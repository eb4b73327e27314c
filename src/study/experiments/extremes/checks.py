"""Checks of the extremes: outcomes, limits against predictions, scaling, round-off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from study.evidence import Evidence, Tables, Unjudged, pick_worst, require_preconditions

LIMIT_NAMES = ("predicted_limit", "measured_limit"), ("predicted_tool_limit", "measured_tool_limit")


def outcomes(tables: Tables, table: str) -> Evidence:
    """How many points are called wrong, or are tried but have no finite bound plus allowance that holds."""
    data = tables[table]
    outcome = data["outcome"].values
    error = data["true_error"].values
    bound = data["guaranteed"].values
    allowed = bound + data["allowance"].values
    # A point is right only if error <= bound + allowance is true of numbers; one that was refused has none
    valid = np.isfinite(allowed) & (error <= allowed)
    untried = (outcome == "refused") & np.isnan(error) & np.isnan(bound)
    wrong = ~(valid | untried) | (outcome == "wrong") | (data["tool"].values == "wrong")
    names = data["axis_of"].values
    rows = {str(name): float(np.count_nonzero(wrong[names == name])) for name in data["axis"].values}
    return pick_worst(rows, "wrong points on an axis", 0.0, False)


def no_earlier(tables: Tables, table: str) -> Evidence:
    """How many limits are met before the value up to which all was predicted to be right.

    NaN stands for a prediction that all is right everywhere.
    """
    data = tables[table]
    rows = {}
    for name in data["axis"].values:
        values = data["value"].values[data["axis_of"].values == name]
        # -1 where values fall towards the extreme, so that `sign` times them always rises
        sign = 1 if values[-1] > values[0] else -1
        pairs = [[float(data[key].sel(axis=name)) for key in pair] for pair in LIMIT_NAMES]
        early = [np.isfinite(measured) and not sign * measured >= sign * limit for limit, measured in pairs]
        rows[str(name)] = float(sum(early))
    return pick_worst(rows, "limits of an axis met too early", 0.0, False)


def step_limit(tables: Tables, table: str, nearest: Mapping[str, float]) -> Evidence:
    """How many steps rho converge above the limit or fail below it.

    `nearest` has, by axis, the relative distance from the limit at which values have to be tried. Raises
    Unjudged if on either side of a limit none was.
    """
    data = tables[table]
    rows = {}
    untried = []
    for axis, distance in nearest.items():
        on_axis = data["axis_of"].values == axis
        share = data["value"].values[on_axis] / float(data["predicted_limit"].sel(axis=axis))
        wrong = (data["outcome"].values[on_axis] == "right") != (share < 1)
        rows[axis] = float(np.count_nonzero(wrong))
        untried += [
            f"{near:g} of the limit was not tried on the axis {axis}"
            for near in (1 - distance, 1 + distance)
            if not np.isclose(share, near, rtol=1e-9).any()
        ]
    evidence = pick_worst(
        rows, r"values of $\rho$ that fail below the limit or converge above it", 0.0, False
    )
    return require_preconditions(evidence, untried)


def power_law(
    tables: Tables, table: str, axis: str, max_value: float, exponent: float, at_most: float
) -> Evidence:
    """How far the slope of the numbers over the values, both as logarithms, is from an exponent."""
    data = tables[table]
    value = data["value"].values
    number = data["measured"].values
    is_fitted = (data["axis_of"].values == axis) & (value <= max_value) & np.isfinite(number)
    if np.count_nonzero(is_fitted) < 2:
        raise Unjudged(f"fewer than two numbers are known on the axis {axis}")
    # number ~ value^slope
    slope = np.polyfit(np.log(value[is_fitted]), np.log(number[is_fitted]), 1)[0]
    rows = {f"slope over {np.count_nonzero(is_fitted)} values": abs(float(slope) - exponent)}
    return pick_worst(rows, f"how far the slope is from {exponent:g}", at_most, False)


def rounding_floor(tables: Tables, table: str, axis: str, factor: float) -> Evidence:
    """How many numbers are beyond a factor of their predictions, and 1 if they grow no faster than these.

    The numbers themselves are round-off, which differs between CPUs; they are among the lines.
    """
    data = tables[table].isel(point=tables[table]["axis_of"].values == axis)
    value = data["value"].values
    number = data["measured"].values
    expected = data["predicted"].values
    # number/expected outside [1/factor, factor], or NaN
    beyond = ~(np.abs(np.log(number / expected)) <= np.log(factor))
    slope = float(np.polyfit(np.log(expected), np.log(number), 1)[0])
    rows = {
        f"{where:g}: {measured:.2g} for {predicted:.2g}": float(is_beyond)
        for where, measured, predicted, is_beyond in zip(value, number, expected, beyond, strict=True)
    }
    rows[f"slope {slope:.2g}"] = float(not slope > 1)
    return pick_worst(rows, f"floors beyond a factor of {factor:g}, or that grow no faster", 0.0, False)
