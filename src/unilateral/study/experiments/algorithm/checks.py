"""Checks of section 5: Uzawa's algorithm and the partial elimination."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from unilateral.study.ledger.evidence import ZERO, Evidence, Tables, all_of, along_ratio, worst

SAME = 1e-10
"""Round-off may leave so large a relative difference between iterates."""


def steps(
    tables: Tables, table: str, cases: Sequence[str], shares: Sequence[float], reach: float, at_least: bool
) -> Evidence:
    """The distance from lambda_H after the recorded steps, as a share of it."""
    data = tables[table]["distance"].sel(case=list(cases), variant="as meant")
    rows = {
        f"{case}, rho = {share:g} of 2/lambda_max(S)": float(data.sel(case=case, rho_share=share))
        for case in cases
        for share in shares
    }
    return worst(rows, "the distance from lambda_H after the steps", reach, at_least)


def cycle(
    tables: Tables, table: str, cases: Sequence[str], shares: Sequence[float], least: float, most: float
) -> Evidence:
    """For steps above the limit the smallest distance that is left, and the largest, which is bounded."""
    left = steps(tables, table, cases, shares, least, True)
    return all_of(left, steps(tables, table, cases, shares, most, False))


def clip(tables: Tables, table: str, case: str, share: float, least: float) -> Evidence:
    """The distance without the clip over that with it."""
    data = tables[table]["distance"].sel(case=case, rho_share=share)
    without, with_clip = (float(data.sel(variant=name)) for name in ("without the clip", "as meant"))
    rows = {"without the clip, over as meant": without / with_clip}
    return worst(rows, f"distances without the clip over those with it, {case}", least, True)


def printed_index(
    tables: Tables, table: str, cases: Sequence[str], below: float, above: float, least: float
) -> Evidence:
    """The distances as printed over those as meant: many times above half the limit, at most twice below."""
    distance = tables[table]["distance"].sel(case=list(cases))
    quotient = distance.sel(variant="as printed") / distance.sel(variant="as meant")

    def at(share: float, required: float, at_least: bool) -> Evidence:
        rows = {case: float(quotient.sel(case=case, rho_share=share)) for case in cases}
        return worst(
            rows, f"as printed over as meant at rho = {share:g} of 2/lambda_max(S)", required, at_least
        )

    return all_of(at(above, least, True), at(below, 2.0, False))


def step_limit(tables: Tables, scenes: Sequence[str], most: float) -> Evidence:
    """1 - sigma_1 lambda_max(S) on the unit square, which is to be at least 0 and at most `most`.

    sigma_1 is the first Steklov eigenvalue of the square.
    """
    sigma_1 = np.tanh(8**-0.5) / np.sqrt(2)
    below = {scene: 1 - sigma_1 * float(tables[f"{scene}/errors"]["lambda_max"].max()) for scene in scenes}
    quantity = "1 - sigma_1 lambda_max(S) on the finest meshes"
    return all_of(worst(below, quantity, most, False), worst(below, quantity, -ZERO, True))


def economy(tables: Tables, table: str, least: float) -> Evidence:
    """Operations of a step with A factorised over those with A_3, on every mesh; iterates are the same."""
    data = tables[table]
    shares = (data["with_A"] / data["with_A_3"]).values
    rows = {f"h = {h:g}": float(share) for h, share in zip(data["h"].values, shares, strict=True)}
    difference = {"difference": float(data["difference"])}
    return all_of(
        worst(rows, "operations with A over those with A_3", least, True),
        worst(difference, "how far the iterates are apart, relative", SAME, False),
    )


def step_growth(tables: Tables, scene: str, case: str, H_over_h: float, most: float) -> Evidence:
    """The largest over the smallest of H steps / log(1/tolerance) for plain Uzawa, whose steps are O(1/H)."""
    table = tables[f"{scene}/errors"].sel(case=case)
    iterations, tolerance, sizes = (
        along_ratio(table, name, H_over_h) for name in ("iterations", "tolerance", "H")
    )
    scaled = iterations * sizes / np.log(1 / tolerance)
    fine = scaled[2:]
    rows = {"steps times H over the logarithm of the tolerance": float(fine.max() / fine.min())}
    lines = [f"  H = {H:g}: {value:.4g}" for H, value in zip(sizes, scaled, strict=True)]
    return worst(rows, "largest over smallest, H <= 1/16", most, False)._replace(lines=lines)


def saddle(tables: Tables, table: str) -> Evidence:
    """The least of L(v, lambda_H) - L(u_h, lambda_H) and of L(u_h, lambda_H) - L(u_h, mu), relative."""
    data = tables[table]
    rows = {
        f"{case}, {name}": float(data[name].sel(case=case))
        for case in data["case"].values
        for name in ("saddle_in_v", "saddle_in_mu")
    }
    return worst(rows, "the least growth away from the saddle", -ZERO, True)


def two_multipliers(tables: Tables, table: str, apart: float) -> Evidence:
    """How badly the second multiplier solves the problem of the first, and how far both are apart."""
    data = tables[table]
    rows = {name: float(data[name]) for name in ("violation", "same_u")}
    distance = {"multiplier_distance": float(data["multiplier_distance"])}
    return all_of(
        worst(rows, "how far the second multiplier is from a solution with the same u_h", ZERO, False),
        worst(distance, "the distance of the multipliers, relative", apart, True),
    )
