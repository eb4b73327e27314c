"""The check of section 5 that is more than an expression: how the steps of Uzawa's algorithm grow."""

from __future__ import annotations

import numpy as np

from study import tables as stored
from study.evidence import Evidence, Tables, name_values, pick_worst


def step_growth(tables: Tables, scene: str, case: str, H_over_h: float, at_most: float) -> Evidence:
    """The largest over the smallest of H steps / log(1/tolerance) for plain Uzawa, whose steps are O(1/H)."""
    runs = stored.select_ratio(tables[f"{scene}/errors"].sel(case=case), 1 / H_over_h)
    scaled = runs["iterations"] * runs["H"] / np.log(1 / runs["tolerance"])
    fine = scaled.values[2:]  # H <= 1/16
    rows = {"steps times H over the logarithm of the tolerance": float(fine.max() / fine.min())}
    lines = [f"  {name}: {value:.4g}" for name, value in name_values(scaled, "H = {H:g}").items()]
    return pick_worst(rows, r"largest over smallest, $H \le 1/16$", at_most, False)._replace(lines=lines)
