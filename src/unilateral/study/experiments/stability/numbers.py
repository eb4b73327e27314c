"""Tables of beta, as documents show them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from unilateral.study.formats import shown

MEASURES = {
    "h_over_H": "h/H",
    "edges_per_cell": "fewest boundary edges in a cell",
    "cell_over_edge": "smallest $H_i$ over the longest edge at it",
}
ROUNDED = 1e-4
"""Relative, of the numbers in a committed table."""


def beta(pairs: pd.DataFrame, ratios: Sequence[float]) -> pd.DataFrame:
    """Lower bounds of beta on uniform meshes, per family of meshes and H/h."""
    rows = []
    for label, of in pairs[pairs["kind"] == "uniform"].groupby("label", sort=False):
        at = {ratio: np.isclose(of["h_over_H"] * ratio, 1, rtol=ROUNDED) for ratio in ratios}
        least = {f"{ratio:g}": float(of.loc[here, "beta_lower"].min()) for ratio, here in at.items()}
        rows.append({"β ≥ ... at H/h =": label} | {name: shown(b, "down.2f") for name, b in least.items()})
    return pd.DataFrame(rows)


def correlations(pairs: pd.DataFrame, smallest_angle: float) -> pd.DataFrame:
    """Which measure of h/H predicts beta best, on meshes that are not uniform: Spearman's coefficients."""
    other = pairs[(pairs["kind"] != "uniform") & (pairs["edges_per_cell"] > 0)]
    of = {
        "pairs that are not uniform": other,
        f"of them without angles below {smallest_angle:g}°": other[other["smallest_angle"] >= smallest_angle],
    }
    rows = []
    for what, kept in of.items():
        found = {name: kept[name].corr(kept["beta_lower"], method="spearman") for name in MEASURES}
        rows.append(
            {"rank correlation of β with": f"{len(kept)} {what}"}
            | {MEASURES[name]: f"{value:.2f}" for name, value in found.items()}
        )
    return pd.DataFrame(rows)
