"""Checks of section 5: Uzawa's algorithm and the partial elimination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unilateral.checks.found import Found, Tables, along_ratio, worst


def steps(
    tables: Tables, table: str, cases: Sequence[str], shares: Sequence[float], reach: float, at_least: bool
) -> Found:
    """The distance from lambda_H after the recorded steps, as a share of it."""
    of = tables[table]["distance"].sel(case=list(cases), variant="as meant")
    rows = {
        f"{case}, rho = {share:g} of 2/lambda_max(S)": float(of.sel(case=case, rho_share=share))
        for case in cases
        for share in shares
    }
    return worst(rows, "the distance from lambda_H after the steps", reach, at_least)


def printed_index(tables: Tables, table: str, cases: Sequence[str], share: float, least: float) -> Found:
    """With u^n of lambda^(n-1): the distance that is left where the corrected algorithm converges."""
    of = tables[table]["distance"].sel(case=list(cases), rho_share=share)
    rows = {
        case: float(of.sel(case=case, variant="as printed") / of.sel(case=case, variant="as meant"))
        for case in cases
    }
    return worst(rows, f"as printed over as meant at rho = {share:g} of 2/lambda_max(S)", least, True)


def step_limit(tables: Tables, scenes: Sequence[str]) -> Found:
    """The largest sigma_1 lambda_max(S) on the unit square, sigma_1 its first Steklov eigenvalue."""
    sigma_1 = np.tanh(8**-0.5) / np.sqrt(2)
    rows = {scene: float(sigma_1 * tables[f"{scene}/errors"]["lambda_max"].max()) for scene in scenes}
    return worst(rows, "the largest sigma_1 lambda_max(S)", 1 + 1e-12, False)


def economy(tables: Tables, table: str, least: float) -> Found:
    """Operations of a step with A factorised over those with A_3, on every mesh."""
    of = tables[table]
    shares = (of["with_A"] / of["with_A_3"]).values
    rows = {f"h = {h:g}": float(share) for h, share in zip(of["h"].values, shares, strict=True)}
    return worst(rows, "operations with A over those with A_3", least, True)


def step_growth(tables: Tables, scene: str, case: str, most: float) -> Found:
    """Steps of plain Uzawa times H over the logarithm of the tolerance, largest over smallest: O(1/H)."""
    table = tables[f"{scene}/errors"].sel(case=case)
    steps_, tolerance = (along_ratio(table, name, 2) for name in ("iterations", "tolerance"))
    scaled = steps_ * along_ratio(table, "H", 2) / np.log(1 / tolerance)
    rows = {f"H = {H:g}": float(value) for H, value in zip(along_ratio(table, "H", 2), scaled, strict=True)}
    fine = scaled[2:]
    found = float(fine.max() / fine.min())
    return worst(rows, "largest over smallest, H <= 1/16", most, False)._replace(observed=found)
