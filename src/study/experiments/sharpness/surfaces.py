"""Rates over the exponents (alpha, gamma) of a transition: measured, predicted, and what the proof leaves.

Errors are r.m.s. means over the positions of the transition in its cell, in H^{-1/2} those of the mean of
the bounds. The consistency term, which bounds a square, is a mean. Beside the norms of `NORMS`
there is `discrete`, D = ||z_h - u_h||_1 = ||lambda - lambda_H||_{-1/2,h}.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from study.tables import NORMS, error_in
from unilateral.arrays import Array

MEASURED = (*NORMS, "discrete")
BEST = {"h1": (1.0, 1.0), "hm12": (1.5, 1.0), "l2": (1.0, 0.5), "discrete": (1.5, 1.0)}
"""The rate by Theorems 2 and 4 is min(first, alpha + second). The first is that of P1 or P0, and
alpha + second that of the regularity."""
PROVED = {"h1": 1.0, "hm12": 1.0, "l2": 0.5, "discrete": 1.0}
"""The rates by Theorem 4.1, for alpha > 0 and gamma >= 1."""
INVERSE = {"h1": 0.0, "hm12": 0.0, "l2": 0.5, "discrete": 0.0}
"""The inverse estimate from H^{-1/2}, (4.7), takes so much from the rate of the consistency term's root."""


def predicted(norm: str, alpha: ArrayLike) -> Array:
    """The rate by Theorem 4, that of the best approximation of u (h1) or lambda; for D in H by Theorem 2."""
    most, smoothness = BEST[norm]
    return np.minimum(most, np.asarray(alpha, dtype=float) + smoothness)


def of_consistency(alpha: ArrayLike, gamma: ArrayLike) -> Array:
    """The rate of <Pi_H lambda, u - g> on transition cells, (4.16): alpha + gamma + 1."""
    return np.asarray(alpha, dtype=float) + np.asarray(gamma, dtype=float) + 1


def left_by_proof(norm: str, alpha: ArrayLike, gamma: ArrayLike) -> Array:
    """The predicted rate or, where smaller, that of the root of <Pi_H lambda, u - g>: (4.10) adds both."""
    return np.minimum(predicted(norm, alpha), of_consistency(alpha, gamma) / 2 - INVERSE[norm])


def taken_by_logarithm(sizes: ArrayLike) -> Array:
    """(pair,) what a factor 1 + ln 1/H takes from rates between sizes H (level,); its root takes half."""
    H = np.asarray(sizes, dtype=float)
    L = 1 - np.log(H)
    return np.asarray(np.log(L[1:] / L[:-1]) / np.log(H[:-1] / H[1:]))


def bend(norm: str) -> float:
    """The alpha at which the regularity no longer limits the predicted rate."""
    most, smoothness = BEST[norm]
    return most - smoothness


def bend_left(norm: str, gamma: float) -> float:
    """The alpha at which the root of the consistency term has the best of the predicted rates."""
    return 2 * (BEST[norm][0] + INVERSE[norm]) - gamma - 1


def along_levels(levels: Sequence[xr.Dataset]) -> xr.Dataset:
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


def rates_over(errors: xr.Dataset) -> xr.Dataset:
    """Rates of adjacent levels by norm, pair, alpha and gamma, with the predicted ones.

    `uncertainty` is the distance between the rates of the two finest pairs; `share` the largest algebraic
    error over positions, as part of the error in that norm; `converged` is 1 where all positions did. `t` is
    H^{-1/2} ||Pi_H(u - z_h)||_0 of Theorem 4, on which gamma has no influence, and `t_rate` its rate. `held`
    is the share of positions at which the transition's cell has a multiplier.
    """
    H = errors["H"].values
    alpha = errors["alpha"].values
    gamma = errors["gamma"].values
    error = np.stack([_mean(error_in(errors, norm) ** 2) ** 0.5 for norm in MEASURED])
    t = _mean(errors["ritz_means"] ** 2 / errors["H"]) ** 0.5
    consistency = _mean(errors["consistency"])
    rate = _rates(error, H)
    by_norm = ("norm", "alpha", "gamma")
    surface = ("alpha", "gamma")
    pairs = ("pair", "alpha", "gamma")
    levels = ("level", "alpha", "gamma")
    a = alpha[:, None]
    c = gamma[None]
    return xr.Dataset(
        {
            "error": (("norm", *levels), error),
            "rate": (("norm", *pairs), rate),
            "uncertainty": (by_norm, np.abs(rate[:, -1] - rate[:, -2])),
            "predicted": (("norm", "alpha"), np.stack([predicted(norm, alpha) for norm in MEASURED])),
            "proved": ("norm", [PROVED[norm] for norm in MEASURED]),
            "left_by_proof": (by_norm, np.stack([left_by_proof(norm, a, c) for norm in MEASURED])),
            "held": (levels, _mean(errors["held"])),
            "t": (levels[:2], t[..., 0]),
            "t_rate": (pairs[:2], _rates(t, H)[..., 0]),
            "consistency": (levels, consistency),
            "consistency_rate": (pairs, _rates(consistency, H)),
            "consistency_predicted": (surface, of_consistency(a, c)),
            "share": (("norm", *levels), np.stack([_share(errors, norm) for norm in MEASURED])),
            "converged": (levels, _of_levels(errors["converged"].min("position"))),
            "j": (surface, np.broadcast_to(a > 0, (len(alpha), len(gamma))).astype(float)),
            "jj": (surface, ((a >= 0) & (c >= 1)).astype(float)),
        },
        coords={
            "norm": list(MEASURED),
            "alpha": alpha,
            "gamma": gamma,
            "h": ("level", errors["h"].values),
            "H": ("level", H),
        },
    )


def over_all_levels(rates: xr.Dataset, norm: str) -> xr.DataArray:
    """(alpha, gamma) the rate of an error from the coarsest to the finest H."""
    error = rates["error"].sel(norm=norm, drop=True)
    H = rates["H"].values
    return np.log(error.isel(level=0) / error.isel(level=-1)) / np.log(H[0] / H[-1])


def of_largest(rates: xr.Dataset, norm: str) -> xr.DataArray:
    """(pair, alpha) rates of the largest error over gamma: the constant of Theorem 4 is one for all."""
    largest = rates["error"].sel(norm=norm, drop=True).max("gamma", skipna=False)
    error = xr.ufuncs.log(largest).diff("level")
    H = xr.ufuncs.log(rates["H"]).diff("level")
    return (error / H).rename(level="pair")


def _of_levels(array: xr.DataArray) -> Array:
    return np.asarray(array.transpose("level", "alpha", "gamma").values, dtype=float)


def _mean(array: xr.DataArray) -> Array:
    return _of_levels(array.mean("position", skipna=False))


def _rates(error: Array, H: Array) -> Array:
    """(..., pair, alpha, gamma) from errors (..., level, alpha, gamma)."""
    steps = np.log(H[:-1] / H[1:])[:, None, None]
    return np.asarray(np.log(error[..., :-1, :, :] / error[..., 1:, :, :]) / steps)


def _share(errors: xr.Dataset, norm: str) -> Array:
    """The share as rates are judged: the bound turned into that norm, over the error's lower bound."""
    beta = errors["beta_lower"]
    lambda_min = errors["lambda_min"]
    one = xr.ones_like(beta)
    to_norm = {"h1": one, "hm12": beta, "l2": lambda_min**0.5, "discrete": one}[norm]
    share = errors["algebraic_bound"] / to_norm / error_in(errors, norm, "lower")
    return _of_levels(share.max("position", skipna=False))
