"""Checks of the extremes: outcomes, limits against predictions, the step, scaling, round-off."""

from __future__ import annotations

import numpy as np

from unilateral.checks.found import Found, Tables, worst

LIMITS = ("predicted_limit", "measured_limit"), ("predicted_tool_limit", "measured_tool_limit")


def outcomes(tables: Tables, table: str) -> Found:
    """How many points are called wrong, or are tried and have no finite bound that holds, allowance added."""
    of = tables[table]
    outcome, error, bound = (of[name].values for name in ("outcome", "true_error", "guaranteed"))
    allowed = bound + of["allowance"].values
    valid = np.isfinite(allowed) & (error <= allowed)
    untried = (outcome == "refused") & np.isnan(error) & np.isnan(bound)
    wrong = ~(valid | untried) | (outcome == "wrong") | (of["tool"].values == "wrong")
    names = of["axis_of"].values
    rows = {str(name): float(np.count_nonzero(wrong[names == name])) for name in of["axis"].values}
    return worst(rows, "wrong points on an axis", 0.0, False)


def no_earlier(tables: Tables, table: str) -> Found:
    """How many limits are met before the value up to which all was predicted to be right; NaN: everywhere."""
    of, rows = tables[table], {}
    for name in of["axis"].values:
        values = of["value"].values[of["axis_of"].values == name]
        sign = 1 if values[-1] > values[0] else -1
        pairs = [[float(of[key].sel(axis=name)) for key in pair] for pair in LIMITS]
        early = [np.isfinite(measured) and not sign * measured >= sign * limit for limit, measured in pairs]
        rows[str(name)] = float(sum(early))
    return worst(rows, "limits of an axis met too early", 0.0, False)


def step_limit(tables: Tables, table: str, axes: list[str], most: float) -> Found:
    """How far above the predicted limit the first step rho that fails is, relative; inf if it is below."""
    limits = tables[table].sel(axis=axes)
    beyond = (limits["measured_limit"] / limits["predicted_limit"]).values - 1
    rows = {axis: float(each) if each >= 0 else np.inf for axis, each in zip(axes, beyond, strict=True)}
    return worst(rows, "the first rho that fails, over the predicted limit, less 1", most, False)


def step_beyond(tables: Tables, table: str, axis: str, least: float) -> Found:
    """The first step that fails, over 2/lambda_max(S)."""
    rows = {axis: float(tables[table]["measured_limit"].sel(axis=axis))}
    return worst(rows, "the first rho that fails, over 2/lambda_max(S)", least, True)


def power(tables: Tables, table: str, axis: str, below: float, exponent: float, most: float) -> Found:
    """How far the slope of the numbers over the values, logarithms both, is from an exponent."""
    of = tables[table]
    value, number = of["value"].values, of["measured"].values
    kept = (of["axis_of"].values == axis) & (value <= below) & np.isfinite(number)
    slope = np.polyfit(np.log(value[kept]), np.log(number[kept]), 1)[0]
    rows = {f"slope over {np.count_nonzero(kept)} values": abs(float(slope) - exponent)}
    return worst(rows, f"how far the slope is from {exponent:g}", most, False)


def floor(tables: Tables, table: str, axis: str, most: float) -> Found:
    """The largest factor between a number and its prediction, either way."""
    of = tables[table].isel(point=tables[table]["axis_of"].values == axis)
    share = of["measured"].values / of["predicted"].values
    rows = {
        f"{value:g}: {number:.2g} of": float(max(each, 1 / each))
        for value, number, each in zip(of["value"].values, of["measured"].values, share, strict=True)
    }
    return worst(rows, "the largest factor between floor and prediction", most, False)
