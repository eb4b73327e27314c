"""Checks of section 3 and of the dual norm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from unilateral.norms.dual import Gram
from unilateral.norms.pairing import least_pairing_constant
from unilateral.norms.resolution import fine, steep
from unilateral.study.ledger.evidence import (
    ZERO,
    Evidence,
    Tables,
    all_of,
    along_ratio,
    forms,
    inverse_constant,
    worst,
)


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


def vanishes(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """lambda_min(S) / lambda_max(S) where H <= h, on structured meshes: beta = 0."""
    found = {}
    for scene in scenes:
        table = tables[f"{scene}/errors"]
        share = (table["lambda_min"] / table["lambda_max"]).values
        too_fine = (table["h_over_H"].values >= 1 - 1e-12) & np.isfinite(share)
        found[scene] = float(share[too_fine].max()) if too_fine.any() else np.nan
    return worst(found, "the largest lambda_min(S)/lambda_max(S) at H <= h", ZERO, False)


def closed_form(tables: Tables, scene: str) -> Evidence:
    """||1||_{-1/2} of the unit square, (8 + 4 coth(1/2))^{1/2}, against both bounds."""
    gram = Gram.of_table(tables[f"{scene}/dual_norm"])
    one = np.ones(gram.n_cells)
    exact = np.sqrt(8 + 4 / np.tanh(0.5))
    lower, upper = (np.sqrt(one @ form @ one) for form in gram.p0)
    lines = [f"  {lower:.10g} <= {exact:.10g} <= {upper:.10g}"]
    outside = max(lower / exact - 1, 1 - upper / exact, upper / lower - 1)
    return Evidence("how far the bounds are from it and apart", float(outside), 5e-3, False, lines)


def inverse_estimate(tables: Tables, scenes: Sequence[str], H_over_h: float) -> Evidence:
    """C of ||mu||_0 <= C H^{-1/2} ||mu||_{-1/2} on P0(T_H) times beta_0: at most 1, for V_h is a part of H^1.

    C is that of the norm from below, so not too small. The lines are the constants.
    """
    found, constants = {}, []
    for scene in scenes:
        errors = tables[f"{scene}/errors"]
        for k, (cells, gram) in enumerate(forms(tables, scene)):
            at = np.isclose(errors["h_over_H"].values[:, k], 1 / H_over_h)
            if at.any():
                C, name = inverse_constant(cells, gram.p0.lower), f"{scene}, H = {cells.H:g}"
                found[name] = C * float(errors["beta_0"].values[at, k].max())
                constants.append(f"  {name}: C = {C:.4g}")
    return worst(found, f"the largest C beta_0 at H = {H_over_h:g}h", 1.0, False)._replace(lines=constants)


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


def near(tables: Tables, table: str, variable: str, value: float, most: float, quantity: str) -> Evidence:
    """How far a variable is from a value, relative to it."""
    found = tables[table][variable].values
    return worst({variable: float(np.max(np.abs(found / value - 1)))}, quantity, most, False)


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


def gap(tables: Tables, scenes: Sequence[str], most: float) -> Evidence:
    """The largest upper/lower - 1 of the errors in the dual norm that are not 0, and the smallest."""
    largest, smallest = {}, {}
    for scene in scenes:
        data = tables[f"{scene}/errors"]
        lower, upper = (data[f"hm12_error_{bound}"] for bound in ("lower", "upper"))
        apart = (upper / lower - 1).where(upper > ZERO * data["u_norm"])
        largest[scene], smallest[scene] = float(apart.max()), float(apart.min())
    return all_of(
        worst(largest, "the largest gap", most, False), worst(smallest, "the smallest gap", 0.0, True)
    )
