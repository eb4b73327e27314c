"""Rates over the exponents (alpha, gamma) of a transition: measured, predicted, and what the proof leaves.

Errors are r.m.s. means over the positions of the transition in its cell, in H^{-1/2} those of the mean of
the bounds. The consistency term, which bounds a square, is a mean. Beside the norms of `ERROR_NORMS`
there is `discrete`, D = ||z_h - u_h||_1 = ||lambda - lambda_H||_{-1/2,h}.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from study.tables import ERROR_NORMS, error_in_norm
from unilateral.arrays import Array

ERROR_MEASURES = (*ERROR_NORMS, "discrete")
THEOREM_4_RATES = {"h1": (1.0, 1.0), "hm12": (1.5, 1.0), "l2": (1.0, 0.5), "discrete": (1.5, 1.0)}
"""The rate by Theorems 2 and 4 is min(first, alpha + second). The first is that of P1 or P0, and
alpha + second that of the regularity."""
THEOREM_4_1_RATES = {"h1": 1.0, "hm12": 1.0, "l2": 0.5, "discrete": 1.0}
"""The rates by Theorem 4.1, for alpha > 0 and gamma >= 1."""
INVERSE_ESTIMATE_LOSS = {"h1": 0.0, "hm12": 0.0, "l2": 0.5, "discrete": 0.0}
"""The inverse estimate from H^{-1/2}, (4.7), takes so much from the rate of the consistency term's root."""


def predicted_rate(norm: str, alpha: ArrayLike) -> Array:
    """The rate by Theorem 4, that of the best approximation of u (h1) or lambda; for D in H by Theorem 2."""
    best_rate, smoothness = THEOREM_4_RATES[norm]
    return np.minimum(best_rate, np.asarray(alpha, dtype=float) + smoothness)


def consistency_rate(alpha: ArrayLike, gamma: ArrayLike) -> Array:
    """The rate of <Pi_H lambda, u - g> on transition cells, (4.16): alpha + gamma + 1."""
    return np.asarray(alpha, dtype=float) + np.asarray(gamma, dtype=float) + 1


def proof_rate(norm: str, alpha: ArrayLike, gamma: ArrayLike) -> Array:
    """The predicted rate or, where smaller, that of the root of <Pi_H lambda, u - g>: (4.10) adds both."""
    return np.minimum(
        predicted_rate(norm, alpha), consistency_rate(alpha, gamma) / 2 - INVERSE_ESTIMATE_LOSS[norm]
    )


def logarithm_loss(sizes: ArrayLike) -> Array:
    """Rates (pair,) that a factor 1 + ln 1/H takes between neighbouring sizes H; its root takes half."""
    H = np.asarray(sizes, dtype=float)
    L = 1 - np.log(H)  # an error H^p L has the rate p - log(L_2 / L_1) / log(H_1 / H_2)
    return np.asarray(np.log(L[1:] / L[:-1]) / np.log(H[:-1] / H[1:]))


def predicted_bend(norm: str) -> float:
    """The alpha at which the regularity no longer limits the predicted rate."""
    best_rate, smoothness = THEOREM_4_RATES[norm]
    return best_rate - smoothness


def proof_bend(norm: str, gamma: float) -> float:
    """The alpha at which the root of the consistency term has the best of the predicted rates."""
    return 2 * (THEOREM_4_RATES[norm][0] + INVERSE_ESTIMATE_LOSS[norm]) - gamma - 1


def join_sharpness_levels(levels: Sequence[xr.Dataset]) -> xr.Dataset:
    """One table, with the dimension `level`, from those of single levels, coarse to fine."""
    together = xr.concat(
        levels,
        "level",
        data_vars="all",
        coords="minimal",
        compat="override",
        join="exact",
        combine_attrs="drop",
    )
    return together.set_coords(["h", "H"])


def tabulate_surfaces(errors: xr.Dataset) -> xr.Dataset:
    """Rates of adjacent levels by norm, pair, alpha and gamma, with the predicted ones.

    `uncertainty` is the distance between the rates of the two finest pairs; `share` the largest algebraic
    error over positions, as part of the error in that norm; `converged` is 1 where all positions did. `t` is
    H^{-1/2} ||Pi_H(u - z_h)||_0 of Theorem 4, on which gamma has no influence, and `t_rate` its rate. `held`
    is the share of positions at which the transition's cell has a multiplier.
    """
    alpha = errors["alpha"].values
    gamma = errors["gamma"].values
    levels = {"h": ("level", errors["h"].values), "H": ("level", errors["H"].values)}
    coords = {"norm": list(ERROR_MEASURES), "alpha": alpha, "gamma": gamma} | levels
    return xr.Dataset(_measure_rates(errors) | _predict_rates(alpha[:, None], gamma[None]), coords=coords)


def _measure_rates(errors: xr.Dataset) -> dict[str, Any]:
    """The measured variables of `tabulate_surfaces`, each with its dimensions."""
    H = errors["H"].values
    # R.m.s. means over the positions; the consistency term bounds a square, and so it has a mean
    error = np.stack([_position_mean(error_in_norm(errors, norm) ** 2) ** 0.5 for norm in ERROR_MEASURES])
    rate = _adjacent_rates(error, H)
    # t = H^{-1/2} ||Pi_H(u - z_h)||_0, which is the same for every gamma: the first stands for all
    t = _position_mean(errors["ritz_means"] ** 2 / errors["H"]) ** 0.5
    consistency = _position_mean(errors["consistency"])
    share = np.stack([_algebraic_share(errors, norm) for norm in ERROR_MEASURES])
    surface = ("alpha", "gamma")
    return {
        "error": (("norm", "level", *surface), error),
        "rate": (("norm", "pair", *surface), rate),
        "uncertainty": (("norm", *surface), np.abs(rate[:, -1] - rate[:, -2])),
        "held": (("level", *surface), _position_mean(errors["held"])),
        "t": (("level", "alpha"), t[..., 0]),
        "t_rate": (("pair", "alpha"), _adjacent_rates(t, H)[..., 0]),
        "consistency": (("level", *surface), consistency),
        "consistency_rate": (("pair", *surface), _adjacent_rates(consistency, H)),
        "share": (("norm", "level", *surface), share),
        "converged": (("level", *surface), _level_values(errors["converged"].min("position"))),
    }


def _predict_rates(alpha: Array, gamma: Array) -> dict[str, Any]:
    """Rates by the theorems and their proof, and whether (j) and (jj) hold; alpha (a, 1), gamma (1, c)."""
    surface = ("alpha", "gamma")
    predicted = np.stack([predicted_rate(norm, alpha[:, 0]) for norm in ERROR_MEASURES])
    left_by_proof = np.stack([proof_rate(norm, alpha, gamma) for norm in ERROR_MEASURES])
    # (j): u in H^2, that is, alpha > 0; (jj): u and g Lipschitz on every side
    j = np.broadcast_to(alpha > 0, left_by_proof.shape[1:])
    jj = (alpha >= 0) & (gamma >= 1)
    return {
        "predicted": (("norm", "alpha"), predicted),
        "proved": ("norm", [THEOREM_4_1_RATES[norm] for norm in ERROR_MEASURES]),
        "left_by_proof": (("norm", *surface), left_by_proof),
        "consistency_predicted": (surface, consistency_rate(alpha, gamma)),
        "j": (surface, j.astype(float)),
        "jj": (surface, jj.astype(float)),
    }


def overall_rate(rates: xr.Dataset, norm: str) -> xr.DataArray:
    """The rate of an error from the coarsest to the finest H, by (alpha, gamma)."""
    error = rates["error"].sel(norm=norm, drop=True)
    H = rates["H"].values
    return np.log(error.isel(level=0) / error.isel(level=-1)) / np.log(H[0] / H[-1])


def largest_error_rate(rates: xr.Dataset, norm: str) -> xr.DataArray:
    """Rates of the largest error over gamma, by (pair, alpha): Theorem 4 has one constant for all gamma."""
    largest = rates["error"].sel(norm=norm, drop=True).max("gamma", skipna=False)
    error = xr.ufuncs.log(largest).diff("level")
    H = xr.ufuncs.log(rates["H"]).diff("level")
    return (error / H).rename(level="pair")


def _level_values(array: xr.DataArray) -> Array:
    return np.asarray(array.transpose("level", "alpha", "gamma").values, dtype=float)


def _position_mean(array: xr.DataArray) -> Array:
    return _level_values(array.mean("position", skipna=False))


def _adjacent_rates(error: Array, H: Array) -> Array:
    """Rates (..., pair, alpha, gamma) between adjacent levels of errors (..., level, alpha, gamma)."""
    steps = np.log(H[:-1] / H[1:])[:, None, None]
    return np.asarray(np.log(error[..., :-1, :, :] / error[..., 1:, :, :]) / steps)


def _algebraic_share(errors: xr.Dataset, norm: str) -> Array:
    """The share as rates are judged: the bound turned into that norm, over the error's lower bound."""
    # The bound is one in ||.||_{-1/2,h} >= beta ||.||_{-1/2} and >= lambda_min(S)^{1/2} ||.||_0
    beta = errors["beta_lower"]
    lambda_min = errors["lambda_min"]
    ones = xr.ones_like(beta)
    to_norm = {"h1": ones, "hm12": beta, "l2": lambda_min**0.5, "discrete": ones}[norm]
    share = errors["algebraic_bound"] / to_norm / error_in_norm(errors, norm, "lower")
    return _level_values(share.max("position", skipna=False))
