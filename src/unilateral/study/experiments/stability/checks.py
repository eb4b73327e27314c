"""Checks of section 3 and of the dual norm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unilateral.norms.resolution import fine, steep
from unilateral.study.beta import least_pairing_constant
from unilateral.study.ledger.evidence import (
    ZERO,
    Evidence,
    Tables,
    worst,
)


def vanishes(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """lambda_min(S) / lambda_max(S) where H <= h, on structured meshes: beta = 0."""
    found = {}
    for scene in scenes:
        table = tables[f"{scene}/errors"]
        share = (table["lambda_min"] / table["lambda_max"]).values
        too_fine = (table["h_over_H"].values >= 1 - 1e-12) & np.isfinite(share)
        found[scene] = float(share[too_fine].max()) if too_fine.any() else np.nan
    return worst(found, "the largest lambda_min(S)/lambda_max(S) at H <= h", ZERO, False)


def local_rule(tables: Tables, scenes: Sequence[str], least: float) -> Evidence:
    """The smallest beta where edges are short against their cells and triangles are not flat, by RULE."""
    found = {}
    for scene in scenes:
        data = tables[f"{scene}/infsup"]
        kept = fine(data["cell_over_edge"].values) & steep(data["smallest_angle"].values)
        if kept.any():
            found[scene] = float(data["beta_lower"].values[kept].min())
    return worst(found, "the smallest beta", least, True)


def inner_nodes(
    tables: Tables,
    scenes: Sequence[str],
    variable: str,
    least: float,
    alpha_1: float,
    smallest_angle: float,
) -> Evidence:
    """The smallest constant of Theorem 5 over 4 delta (1 - delta), which is 1 for nodes in the middle."""
    found = {}
    for scene in scenes:
        data = tables[f"{scene}/infsup"]
        delta = data["delta"]
        regular = (data["alpha_1"] <= alpha_1) & (data["smallest_angle"] >= smallest_angle)
        share = (data[variable] / (4 * delta * (1 - delta))).where((delta > 0) & regular)
        if share.notnull().any():
            found[scene] = float(share.min())
    return worst(found, f"the smallest {variable} / (4 delta (1 - delta))", least, True)


def pairing(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """The smallest pairing constant over the bound of Theorem 5's proof, where all cells have inner nodes."""
    found = {}
    for scene in scenes:
        data = tables[f"{scene}/infsup"]
        paired = data["delta"].values > 0
        if paired.any():
            bound = least_pairing_constant(data["delta"].values)
            found[scene] = float((data["pairing"].values[paired] / bound[paired]).min())
    return worst(found, "the smallest singular value over its bound", 1 - ZERO, True)


def certified(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """The smallest constant over its certified lower bound, where that is not 0."""
    found = {}
    for scene in scenes:
        data = tables[f"{scene}/infsup"]
        ratio = (data["beta_0_cellwise"] / data["beta_0_certified"]).where(data["beta_0_certified"] > 0)
        if ratio.notnull().any():
            found[scene] = float(ratio.min())
    return worst(found, "the smallest constant over its bound", 1 - ZERO, True)


def near_ends(tables: Tables, scene: str, tolerance: float) -> Evidence:
    """How far the orders of beta from one H to the next are from 1: at delta = H, and at the least delta."""
    data = tables[f"{scene}/infsup"]
    H, delta = data["H"].values, data["delta"].values
    found: dict[str, float] = {}
    for name, mesh in (
        ("delta = H", np.abs(delta - H).argmin(axis=0)),
        ("least delta", delta.argmin(axis=0)),
    ):
        beta = data["beta_lower"].values[mesh, np.arange(len(H))]
        orders = np.diff(np.log(beta)) / np.diff(np.log(H))
        found |= {f"{name}, H = {size:g}": abs(p - 1) for size, p in zip(H[1:], orders, strict=True)}
    return worst(found, "how far an order of beta is from 1", tolerance, False)


def edges_alone(tables: Tables, scene: str, edges_per_cell: float, most: float) -> Evidence:
    """The smallest beta where every cell has so many boundary edges."""
    data = tables[f"{scene}/infsup"]
    counted = data["beta_upper"].where(data["edges_per_cell"] >= edges_per_cell * (1 - 1e-9))
    quantity = f"the smallest beta with {edges_per_cell:g} edges in every cell"
    return worst({scene: float(counted.min())}, quantity, most, False)
