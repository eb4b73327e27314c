"""Tables of beta, as documents show them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from study.formats import format_value
from unilateral.formulas.formula import parse_real
from unilateral.norms.resolution import RULE

RATIO_TITLES = {
    "h_over_H": "h/H",
    "edges_per_cell": "fewest boundary edges in a cell",
    "cell_over_edge": "smallest $H_i$ over the longest edge at it",
}
TABLE_ROUNDING = 5e-4
"""Numbers in a committed table have four digits: each is off by at most this times itself."""


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """Bounds on beta and counts of pairs, as documents name them."""
    pairs = results["figures/infsup"]
    return {
        "beta": summarise_rule(pairs, *RULE)
        | summarise_uniform_beta(pairs)
        | summarise_inner_nodes(pairs)
        | summarise_fortin_bound(pairs)
    }


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of beta on uniform meshes, and of its rank correlations."""
    ratios = [parse_real(ratio, "uniform_ratios") for ratio in study["infsup"]["uniform_ratios"]]
    return {
        "beta": tabulate_least_beta(results["figures/infsup"], ratios),
        "correlations": tabulate_correlations(results["figures/infsup"], RULE.smallest_angle),
    }


def tabulate_least_beta(pairs: pd.DataFrame, ratios: Sequence[float]) -> pd.DataFrame:
    """Lower bounds on beta on uniform meshes, per family of meshes and H/h."""
    rows = []
    for label, family in pairs[pairs["kind"] == "uniform"].groupby("label", sort=False):
        row = {r"$\beta$ at least, at $H/h$ =": label}
        for ratio in ratios:
            has_ratio = np.isclose(family["h_over_H"] * ratio, 1, rtol=TABLE_ROUNDING)
            row[f"{ratio:g}"] = format_value(float(family.loc[has_ratio, "beta_lower"].min()), "down.2f")
        rows.append(row)
    return pd.DataFrame(rows)


def tabulate_correlations(pairs: pd.DataFrame, smallest_angle: float) -> pd.DataFrame:
    """Which measure of h/H predicts beta best, on meshes that are not uniform: Spearman's coefficients."""
    irregular = pairs[(pairs["kind"] != "uniform") & (pairs["edges_per_cell"] > 0)]
    wide = irregular[irregular["smallest_angle"] >= smallest_angle]
    groups = {
        "pairs that are not uniform": irregular,
        f"of them without angles below {smallest_angle:g}°": wide,
    }
    rows = []
    for title, group in groups.items():
        row = {r"rank correlation of $\beta$ with": f"{len(group)} {title}"}
        for name, heading in RATIO_TITLES.items():
            row[heading] = f"{group[name].corr(group['beta_lower'], method='spearman'):.2f}"
        rows.append(row)
    return pd.DataFrame(rows)


def summarise_rule(pairs: pd.DataFrame, cell_over_edge: float, smallest_angle: float) -> dict[str, Any]:
    """How many pairs keep the rule; the worst one with flat triangles; the angle of the worst of a search."""
    limit = cell_over_edge * (1 - TABLE_ROUNDING)
    is_flat = pairs["smallest_angle"] < smallest_angle
    fine = pairs["cell_over_edge"] >= limit
    searched = pairs[(pairs["kind"] == "worst") & (pairs["edges_per_cell"] >= limit)]
    flat = pairs[fine & is_flat].nsmallest(1, "beta_upper").iloc[0]
    edges = searched.nsmallest(1, "beta_upper").iloc[0]
    return {
        "kept": len(pairs[fine & ~is_flat]),
        "flat": {"beta": float(flat["beta_upper"]), "mesh": flat["label"]},
        "edges": {"angle": float(edges["smallest_angle"])},
    }


def summarise_uniform_beta(pairs: pd.DataFrame) -> dict[str, Any]:
    """The least beta on uniform meshes with h < H; and that of an odd number of edges at H = h."""
    ratio = pairs["h_over_H"]
    equal = np.isclose(pairs["h_over_H"], 1, rtol=TABLE_ROUNDING)
    below = (pairs["kind"] == "uniform") & (ratio < 1) & ~equal
    odd = pairs.loc[(pairs["scene"] == "betaodd") & equal, "beta_lower"]
    return {"uniform": float(pairs.loc[below, "beta_lower"].min()), "odd": odd.item()}


def summarise_inner_nodes(pairs: pd.DataFrame) -> dict[str, Any]:
    """How many pairs there are; the least beta at h = H with nodes in the middle of the cells."""
    equal = np.isclose(pairs["h_over_H"], 1, rtol=TABLE_ROUNDING) & np.isclose(
        pairs["delta"], 0.5, rtol=TABLE_ROUNDING
    )
    return {
        "pairs": len(pairs),
        "middle": float(pairs.loc[equal & (pairs["alpha_1"] == 1), "beta_lower"].min()),
    }


def summarise_fortin_bound(pairs: pd.DataFrame) -> dict[str, float]:
    """The least beta on structured meshes of the square at H = 2h, and the least of the bounds on it."""
    nested = pairs[
        (pairs["label"] == "square, structured") & np.isclose(pairs["h_over_H"], 0.5, rtol=TABLE_ROUNDING)
    ]
    return {"solved": float(nested["beta_lower"].min()), "unsolved": float(nested["beta_fortin"].min())}
