"""Where the rates that the theorems predict are missed, as documents show it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import pandas as pd
import xarray as xr

from study.experiments.sharpness.surfaces import logarithm_loss
from study.formats import DASH, ERROR_TITLES

POSITIONS_TITLE = "positions with a multiplier in the transition's cell"


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """How far Theorem 2's exponent and Lemma 1's bound are from what is observed."""
    observed = {claim["id"]: claim["observed"] for claim in results["results/claims"]}
    return {"theorems": summarise_theorems(observed)}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The table of exponents at which rates miss the predicted ones."""
    tolerances = {norm: study["rates"]["norms"][norm]["tolerance"] for norm in ("hm12", "l2")}
    return {"exceptions": tabulate_exceptions(results["sharpness/rates"], tolerances)}


def tabulate_exceptions(rates: xr.Dataset, tolerances: Mapping[str, float]) -> pd.DataFrame:
    """Where, for alpha > 0, rates of the multiplier on the finest levels miss those predicted.

    In brackets is what they would lack of a rate with the factor (1 + ln 1/H)^(1/2). A last column tells how
    many positions of the transition have a multiplier in its cell on the finest level.
    """
    missing = (rates["predicted"] - rates["rate"].isel(pair=-1)).where(rates["alpha"] > 0, drop=True)
    log_rate = 0.5 * logarithm_loss(rates["H"].values)[-1]
    has_multiplier = rates["held"].isel(level=-1)
    rows = []
    for alpha, gamma in itertools.product(missing["alpha"].values, missing["gamma"].values):
        norm_misses = {norm: float(missing.sel(norm=norm, alpha=alpha, gamma=gamma)) for norm in tolerances}
        if any(norm_misses[norm] > tolerances[norm] for norm in tolerances):
            lacks = {
                ERROR_TITLES[n]: f"{norm_misses[n]:.2f} ({norm_misses[n] - log_rate:.2f})"
                if norm_misses[n] > tolerances[n]
                else DASH
                for n in tolerances
            }
            share = {POSITIONS_TITLE: f"{100 * float(has_multiplier.sel(alpha=alpha, gamma=gamma)):.3g} %"}
            rows.append({r"$\alpha$": f"{alpha:g}", r"$\gamma$": f"{gamma:g}"} | lacks | share)
    return pd.DataFrame(
        rows,
        columns=[r"$\alpha$", r"$\gamma$", *(ERROR_TITLES[norm] for norm in tolerances), POSITIONS_TITLE],
    )


def summarise_theorems(observed: Mapping[str, float]) -> dict[str, Any]:
    """By how much an exponent of Theorem 2 is missed at most, and how near Lemma 1 comes to its bound."""
    return {"deficit": max(0.0, -observed["T.H"]), "slack": 1 - observed["T.D"]}
