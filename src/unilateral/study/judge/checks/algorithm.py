"""Checks of section 5: Uzawa's algorithm and the partial elimination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unilateral.study.judge.checks.found import ZERO, Found, Tables, along_ratio, worst

SAME = 1e-10
"""Relative difference of iterates that round-off leaves."""


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


def cycle(
    tables: Tables, table: str, cases: Sequence[str], shares: Sequence[float], least: float, most: float
) -> Found:
    """The smallest distance that is left for steps above the limit; 0 if one is larger than `most`."""
    found = steps(tables, table, cases, shares, least, True)
    largest = steps(tables, table, cases, shares, most, False).observed
    return found if largest <= most else found._replace(observed=0.0)


def clip(tables: Tables, table: str, case: str, share: float, least: float) -> Found:
    """The distance without the clip over that with it."""
    of = tables[table]["distance"].sel(case=case, rho_share=share)
    without, with_clip = (float(of.sel(variant=name)) for name in ("without the clip", "as meant"))
    rows = {"without the clip, over as meant": without / with_clip}
    return worst(rows, f"distances without the clip over those with it, {case}", least, True)


def printed_index(
    tables: Tables, table: str, cases: Sequence[str], below: float, above: float, least: float
) -> Found:
    """Above half the limit: distances as printed over as meant; 0 unless both converge below."""
    of = tables[table]["distance"].sel(case=list(cases))
    meant, printed = of.sel(variant="as meant"), of.sel(variant="as printed")
    rows = {
        case: float(printed.sel(case=case, rho_share=above) / meant.sel(case=case, rho_share=above))
        for case in cases
    }
    found = worst(rows, f"as printed over as meant at rho = {above:g} of 2/lambda_max(S)", least, True)
    agree = np.all(printed.sel(rho_share=below) <= 2 * meant.sel(rho_share=below))
    return found if agree else found._replace(observed=0.0)


def step_limit(tables: Tables, scenes: Sequence[str], most: float) -> Found:
    """1 - sigma_1 lambda_max(S) on the unit square, sigma_1 its first Steklov eigenvalue; inf if negative."""
    sigma_1 = np.tanh(8**-0.5) / np.sqrt(2)
    found = {}
    for scene in scenes:
        below = 1 - sigma_1 * float(tables[f"{scene}/errors"]["lambda_max"].max())
        found[scene] = abs(below) if below >= -ZERO else np.inf
    return worst(found, "1 - sigma_1 lambda_max(S) on the finest meshes", most, False)


def economy(tables: Tables, table: str, least: float) -> Found:
    """Operations of a step with A factorised over those with A_3, on every mesh; 0 if iterates differ."""
    of = tables[table]
    shares = (of["with_A"] / of["with_A_3"]).values
    rows = {f"h = {h:g}": float(share) for h, share in zip(of["h"].values, shares, strict=True)}
    found = worst(rows, "operations with A over those with A_3", least, True)
    return found if float(of["difference"]) <= SAME else found._replace(observed=0.0)


def step_growth(tables: Tables, scene: str, case: str, most: float) -> Found:
    """Steps of plain Uzawa times H over the logarithm of the tolerance, largest over smallest: O(1/H)."""
    table = tables[f"{scene}/errors"].sel(case=case)
    steps_, tolerance = (along_ratio(table, name, 2) for name in ("iterations", "tolerance"))
    scaled = steps_ * along_ratio(table, "H", 2) / np.log(1 / tolerance)
    rows = {f"H = {H:g}": float(value) for H, value in zip(along_ratio(table, "H", 2), scaled, strict=True)}
    fine = scaled[2:]
    found = float(fine.max() / fine.min())
    return worst(rows, "largest over smallest, H <= 1/16", most, False)._replace(observed=found)
