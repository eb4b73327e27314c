"""Checks of section 3: beta by the library's rule, by inner nodes, and near the ends of cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from study.evidence import Evidence, Tables, pick_worst
from study.stability_constants import pairing_constant_bound
from unilateral.norms.resolution import is_fine_enough, is_wide_enough

QUOTIENT_ROUNDING = 1e-12
"""By so much rounding may bring a quotient of two equal numbers below 1."""


def local_rule(
    tables: Tables, scenes: Sequence[str], at_least: float, cases: Sequence[str] | None = None
) -> Evidence:
    """The smallest beta where edges are short against their cells and triangles are not flat, by RULE."""
    smallest_beta = {}
    for scene in scenes:
        data = tables[f"{scene}/infsup"]
        data = data if cases is None else data.sel(case=list(cases))
        keeps_rule = is_fine_enough(data["cell_over_edge"].values) & is_wide_enough(
            data["smallest_angle"].values
        )
        if keeps_rule.any():
            smallest_beta[scene] = float(data["beta_lower"].values[keeps_rule].min())
    return pick_worst(smallest_beta, r"the smallest $\beta$", at_least, True)


def pairing(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """The smallest pairing constant over the bound of Theorem 5's proof, where all cells have inner nodes."""
    quotients = {}
    for scene in scenes:
        data = tables[f"{scene}/infsup"]
        paired = data["delta"].values > 0
        if paired.any():
            # sigma >= delta/4, (6)
            bound = pairing_constant_bound(data["delta"].values)
            quotients[scene] = float((data["pairing"].values[paired] / bound[paired]).min())
    return pick_worst(quotients, "the smallest singular value over its bound", 1 - QUOTIENT_ROUNDING, True)


def near_ends(tables: Tables, scene: str, tolerance: float) -> Evidence:
    """How far the orders of beta from one H to the next are from 1: at delta = H, and at the least delta."""
    data = tables[f"{scene}/infsup"]
    H = data["H"].values
    delta = data["delta"].values
    order_errors: dict[str, float] = {}
    for name, mesh in (
        ("delta = H", np.abs(delta - H).argmin(axis=0)),
        ("least delta", delta.argmin(axis=0)),
    ):
        beta = data["beta_lower"].values[mesh, np.arange(len(H))]
        # beta ~ H^p
        orders = np.diff(np.log(beta)) / np.diff(np.log(H))
        order_errors |= {f"{name}, H = {size:g}": abs(p - 1) for size, p in zip(H[1:], orders, strict=True)}
    return pick_worst(order_errors, r"how far an order of $\beta$ is from 1", tolerance, False)
