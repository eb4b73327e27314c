"""Checks that serve several experiments: the worst value of a variable against a bound."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from unilateral.study.ledger.evidence import Evidence, Tables, along_ratio, worst


def values(
    tables: Tables,
    table: str,
    variable: str,
    required: float,
    at_least: bool,
    scenes: Sequence[str] = ("",),
    select: Mapping[str, object] | None = None,
    quantity: str = "",
) -> Evidence:
    """The worst value of a variable in some tables, where it is known."""
    found = {}
    for scene in scenes:
        data = tables[table.format(scene=scene)]
        place = {d: v for d, v in (select or {}).items() if d in data[variable].dims}
        chosen = data[variable].sel(place).values
        known = chosen[~np.isnan(chosen)]
        found[scene or table] = float((np.min if at_least else np.max)(known)) if known.size else np.nan
    return worst(found, quantity or variable, required, at_least)


def smallest(
    tables: Tables, table: str, scenes: Sequence[str], variables: Sequence[str], least: float, quantity: str
) -> Evidence:
    """The smallest value of several variables, where they are known."""
    found = {
        f"{scene}, {name}": float(tables[table.format(scene=scene)][name].min())
        for scene in scenes
        for name in variables
    }
    return worst(found, quantity, least, True)


def at_ratio(
    tables: Tables, table: str, scenes: Sequence[str], variable: str, H_over_h: float, least: float
) -> Evidence:
    """The smallest value over the levels at one H/h."""
    found = {
        scene: float(np.min(along_ratio(tables[table.format(scene=scene)], variable, H_over_h)))
        for scene in scenes
    }
    return worst(found, f"the smallest {variable} at H = {H_over_h:g}h", least, True)


def near(tables: Tables, table: str, variable: str, value: float, most: float, quantity: str) -> Evidence:
    """How far a variable is from a value, relative to it."""
    found = tables[table][variable].values
    return worst({variable: float(np.max(np.abs(found / value - 1)))}, quantity, most, False)
