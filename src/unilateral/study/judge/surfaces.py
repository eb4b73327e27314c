"""Rates over the exponents (alpha, gamma) of a transition: measured, predicted, and what the proof leaves.

Errors are r.m.s. means over the positions of the transition in its cell, in H^{-1/2} those of the mean of
the bounds; of the consistency term, which bounds a square, the mean is taken.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from unilateral.study.judge.rates import NORMS
from unilateral.study.tables import error_in

Array = NDArray[np.float64]
BEST = {"h1": (1.0, 1.0), "hm12": (1.5, 1.0), "l2": (1.0, 0.5)}
"""The best approximation's rate is min(first, alpha + second): of P1, and of the regularity."""
PROVED = {"h1": 1.0, "hm12": 1.0, "l2": 0.5, "consistency": 2.0}
"""By Theorem 4.1 and (4.16), for alpha > 0 and gamma >= 1."""
INVERSE = {"h1": 0.0, "hm12": 0.0, "l2": 0.5}
"""What the inverse estimate from H^{-1/2}, (4.7), takes from the rate of the consistency term's root."""


def predicted(norm: str, alpha: ArrayLike) -> Array:
    """The rate of the best approximation of u (h1) or lambda (hm12, l2) by the discrete spaces."""
    most, smoothness = BEST[norm]
    return np.minimum(most, np.asarray(alpha, dtype=float) + smoothness)


def of_consistency(alpha: ArrayLike, gamma: ArrayLike) -> Array:
    """The rate of <Pi_H lambda, u - g> on transition cells, (4.16): alpha + gamma + 1."""
    return np.asarray(alpha, dtype=float) + np.asarray(gamma, dtype=float) + 1


def left_by_proof(norm: str, alpha: ArrayLike, gamma: ArrayLike) -> Array:
    """The prediction or, where smaller, the rate of the consistency term's root, as (4.10) adds them."""
    return np.minimum(predicted(norm, alpha), of_consistency(alpha, gamma) / 2 - INVERSE[norm])


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
    error over positions, as part of the error in that norm; `converged` is 1 where all positions did.
    """
    H, alpha, gamma = (errors[name].values for name in ("H", "alpha", "gamma"))
    error = np.stack([_mean(error_in(errors, norm) ** 2) ** 0.5 for norm in NORMS])
    consistency = _mean(errors["consistency"])
    rate = _rates(error, H)
    by_norm, surface, pairs = ("norm", "alpha", "gamma"), ("alpha", "gamma"), ("pair", "alpha", "gamma")
    levels = ("level", "alpha", "gamma")
    a, c = alpha[:, None], gamma[None]
    return xr.Dataset(
        {
            "error": (("norm", *levels), error),
            "rate": (("norm", *pairs), rate),
            "uncertainty": (by_norm, np.abs(rate[:, -1] - rate[:, -2])),
            "predicted": (("norm", "alpha"), np.stack([predicted(norm, alpha) for norm in NORMS])),
            "proved": ("norm", [PROVED[norm] for norm in NORMS]),
            "left_by_proof": (by_norm, np.stack([left_by_proof(norm, a, c) for norm in NORMS])),
            "consistency": (levels, consistency),
            "consistency_rate": (pairs, _rates(consistency, H)),
            "consistency_predicted": (surface, of_consistency(a, c)),
            "share": (("norm", *levels), np.stack([_share(errors, norm) for norm in NORMS])),
            "converged": (levels, _of_levels(errors["converged"].min("position"))),
            "j": (surface, np.broadcast_to(a > 0, (len(alpha), len(gamma))).astype(float)),
            "jj": (surface, ((a >= 0) & (c >= 1)).astype(float)),
        },
        coords={
            "norm": list(NORMS),
            "alpha": alpha,
            "gamma": gamma,
            "h": ("level", errors["h"].values),
            "H": ("level", H),
        },
    )


def _of_levels(array: xr.DataArray) -> Array:
    return np.asarray(array.transpose("level", "alpha", "gamma").values, dtype=float)


def _mean(array: xr.DataArray) -> Array:
    return _of_levels(array.mean("position", skipna=False))


def _rates(error: Array, H: Array) -> Array:
    """(..., pair, alpha, gamma) from errors (..., level, alpha, gamma)."""
    steps = np.log(H[:-1] / H[1:])[:, None, None]
    return np.asarray(np.log(error[..., :-1, :, :] / error[..., 1:, :, :]) / steps)


def _share(errors: xr.Dataset, norm: str) -> Array:
    """As rates are judged: the bound turned into that norm, over the error's lower bound."""
    beta, lambda_min = errors["beta_lower"], errors["lambda_min"]
    to_norm = {"h1": xr.ones_like(beta), "hm12": beta, "l2": lambda_min**0.5}[norm]
    share = errors["algebraic_bound"] / to_norm / error_in(errors, norm, "lower")
    return _of_levels(share.max("position", skipna=False))


def sharpness_frame(rates: xr.Dataset) -> pd.DataFrame:
    """What the figure of sharpness is drawn from, in long form by `kind`.

    `measured`: the finest pair's rate with that of the pair `before`, per norm (or consistency), alpha and
    gamma, and whether (jj) holds; `predicted`: points of the predicted lines, a line per gamma for the
    consistency term; `left`: of what the proof leaves; `proved`: ends of the theorem's line; `attained`:
    where the predicted lines meet it.
    """
    rows = []
    for norm in (*NORMS, "consistency"):
        rate = rates["consistency_rate"] if norm == "consistency" else rates["rate"].sel(norm=norm)
        for a, c in np.ndindex(rates.sizes["alpha"], rates.sizes["gamma"]):
            last, before = (float(rate[{"pair": k, "alpha": a, "gamma": c}]) for k in (-1, -2))
            where = {"alpha": float(rates["alpha"][a]), "gamma": float(rates["gamma"][c])}
            jj = int(rates["jj"][a, c])
            rows.append({"kind": "measured", "norm": norm, **where, "rate": last, "before": before, "jj": jj})
        rows += _lines(norm, rates["alpha"].values, rates["gamma"].values)
    return pd.DataFrame(rows)


def _lines(norm: str, alphas: Array, gammas: Array) -> list[dict[str, object]]:
    """The predicted lines, bends included, and the theorem's."""
    ends = np.array([0.0, max(alphas)])
    found = [{"kind": "proved", "norm": norm, "alpha": x, "rate": PROVED[norm]} for x in ends]
    if norm == "consistency":
        found.append({"kind": "attained", "norm": norm, "alpha": 0.0, "gamma": 1.0, "rate": PROVED[norm]})
        lines = [("predicted", gamma, alphas, of_consistency(alphas, gamma)) for gamma in gammas]
    else:
        found.append({"kind": "attained", "norm": norm, "alpha": 0.0, "rate": PROVED[norm]})
        bends = np.unique([*alphas, 0.0, BEST[norm][0] - BEST[norm][1]])
        lines = [("predicted", np.nan, bends, predicted(norm, bends))]
        for gamma in gammas:
            of_root = 2 * (BEST[norm][0] + INVERSE[norm]) - gamma - 1
            x = np.unique([*bends, np.clip(of_root, min(alphas), max(alphas))])
            lines.append(("left", gamma, x, left_by_proof(norm, x, gamma)))
    for kind, gamma, x, y in lines:
        found += [
            {"kind": kind, "norm": norm, "alpha": p, "gamma": gamma, "rate": q}
            for p, q in zip(x, y, strict=True)
        ]
    return found
