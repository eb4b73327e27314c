"""Checks of Lemma 1, of the exponents of Theorems 2 and 4, and of Proposition 3."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from study.evidence import (
    Evidence,
    Tables,
    dual_norm_forms,
    name_values,
    pick_worst,
    require_all,
    select_cases,
)
from study.experiments.sharpness import surfaces
from study.tables import ZERO_ERROR_SHARE, error_in_norm
from unilateral.arrays import Array


def lemma_1(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """D over the bound that Lemma 1 gives with mu = Pi_H lambda, where beta > 0 and D is not 0.

    The bound is the positive root of D^2 = m D + (m + D) k + c, k = min(a/beta, t/beta_0), with m from below
    and beta from above: every factor on its unfavourable side.
    """
    quotients = {}
    for scene in scenes:
        names = list(tables[f"{scene}/dual_norm"]["case"].values)
        runs = tables[f"{scene}/errors"].sel(case=names)
        for p, (cells, gram) in enumerate(dual_norm_forms(tables, scene)):
            zero = np.zeros((1, gram.n_cells))
            # ||lambda - Pi_H lambda||_{-1/2} from below
            m = [float(gram.error_bounds(c, zero).lower[0]) for c in range(len(names))]
            shares = _lemma_1_quotients(runs.isel(partition=p), xr.DataArray(m, dims="case"))
            for case, share in zip(names, shares, strict=True):
                if np.isfinite(share).any():
                    quotients[f"{scene}, {case}, H = {cells.H:g}"] = float(np.nanmax(share))
    return pick_worst(quotients, "$D$ over its bound in Lemma 1", 1.0, False)


def _lemma_1_quotients(runs: xr.Dataset, m: xr.DataArray) -> Array:
    """D over its bound in Lemma 1 by (case, mesh); NaN where beta or D is 0."""
    D = runs["discrete_error"]
    c = runs["consistency"]
    H = float(runs["H"])
    is_proved = (runs["beta_lower"] > 0) & (D / runs["u_norm"] > ZERO_ERROR_SHARE)
    beta = runs["beta_upper"].where(is_proved)
    beta_0 = runs["beta_0"].where(is_proved)
    # D^2 = m D + (m + D) k + c, that is D^2 - (m + k) D - (m k + c) = 0
    k = np.minimum(runs["ritz_error"] / beta, runs["ritz_means"] / H**0.5 / beta_0)
    bound = 0.5 * (m + k + np.sqrt((m + k) ** 2 + 4 * (m * k + c)))
    return np.asarray((D / bound).transpose("case", "mesh").values, dtype=float)


def theorem_4(tables: Tables, table: str, tolerances: Mapping[str, float]) -> Evidence:
    """The least excess over the predicted rate, in tolerances of its norm, on the two finest pairs.

    The rates are those of the largest error over gamma, for the theorem's constant does not depend on gamma;
    alpha > 0.
    """
    rows: dict[str, float] = {}
    for norm, tolerance in tolerances.items():
        excess = _theorem_4_excess(tables[table], norm).isel(pair=[-2, -1]).min("pair", skipna=False)
        rows |= _name_by_alpha(excess / tolerance, f"{norm}, ")
    return pick_worst(rows, "the smallest rate less the predicted one, over its tolerance", -1.0, True)


def theorem_4_sharpness(
    tables: Tables, table: str, largest: Mapping[str, float], tolerance: float
) -> Evidence:
    """The largest excess, over the predicted rate, of the rates as in `theorem_4` on the finest pair.

    It is for 0 < alpha <= `largest` of the norm.
    """
    rows: dict[str, float] = {}
    for norm, alpha in largest.items():
        excess = _theorem_4_excess(tables[table], norm).isel(pair=-1)
        rows |= _name_by_alpha(excess.sel(alpha=excess["alpha"] <= alpha), f"{norm}, ")
    return pick_worst(rows, "the rate of the finest pair less the predicted one", tolerance, False)


def free_position_errors(tables: Tables, table: str, norms: Sequence[str], at_most: float) -> Evidence:
    """The largest error of a position over that for the smallest gamma, for which no position is held.

    It is taken on the two finest levels, for alpha > 0.
    """
    data = tables[table].isel(level=slice(-2, None))
    rows = dict[str, float]()
    freest = data.sel(gamma=data["gamma"].min(), drop=True)
    for norm in norms:
        share = error_in_norm(data, norm) / error_in_norm(freest, norm)
        rows |= _name_by_alpha(share.max(["level", "gamma", "position"], skipna=False), f"{norm}, ")
    has_multiplier = _name_by_alpha(freest["held"].max(["level", "position"], skipna=False))
    return require_all(
        pick_worst(rows, r"an error over that for the smallest $\gamma$", at_most, False),
        pick_worst(has_multiplier, "positions whose cell has a multiplier at the smallest gamma", 0.0, False),
    )


def t_rate(tables: Tables, table: str, tolerance: float) -> Evidence:
    """The least excess of the rates of t over min(3/2, 1 + alpha), for alpha > 0 on the two finest pairs.

    Its logarithm is allowed for.
    """
    data = tables[table]
    power = xr.DataArray(logarithm_power(data["alpha"].values), dims="alpha")
    log_rate = xr.DataArray(surfaces.logarithm_loss(data["H"].values), dims="pair") * power
    expected = data["predicted"].sel(norm="discrete")
    excess = (data["t_rate"] + log_rate - expected).isel(pair=[-2, -1]).min("pair", skipna=False)
    quantity = r"the smallest rate of $t$ with its logarithm, less $\min(3/2, 1 + \alpha)$"
    return pick_worst(_name_by_alpha(excess), quantity, -tolerance, True)


def proposition_3(
    tables: Tables, scenes: Sequence[str], exponents: Mapping[str, float], tolerance: float
) -> Evidence:
    """The least excess of the rates of ||u - z_h||_0 on the boundary over min(2, 3/2 + nu), nu by case.

    The rates are over the last factor of 4, and the logarithm is allowed for.
    """
    excess = {}
    for name, run in select_cases(tables, "{scene}/errors", scenes, exponents).items():
        h = run["h"].values[[-3, -1]]
        error = run["ritz_boundary_error"].values[[-3, -1]]
        nu = exponents[str(run["case"].values)]
        # Proposition 3: C h^{min(2, 3/2 + nu)} times a power of ln(1/h)
        rate = np.log(error[0] / error[1]) / np.log(h[0] / h[1])
        log_rate = float(logarithm_power(nu)) * surfaces.logarithm_loss(h)[0]
        excess[name] = float(rate + log_rate - min(2.0, 1.5 + nu))
    quantity = r"the rate over the last factor of 4 with its logarithm, less $\min(2, 3/2 + \nu)$"
    return pick_worst(excess, quantity, -tolerance, True)


def logarithm_power(nu: ArrayLike) -> Array:
    """The power of ln(1/h) in (5)."""
    a = np.asarray(nu, dtype=float)
    return np.select([a < 0.5, a == 0.5], [0.0, 1.0], 0.5)


def _theorem_4_excess(data: xr.Dataset, norm: str) -> xr.DataArray:
    """Rates of the largest error over gamma, less the predicted ones, by (pair, alpha)."""
    return surfaces.largest_error_rate(data, norm) - surfaces.predicted_rate(norm, data["alpha"])


def _name_by_alpha(values: xr.DataArray, prefix: str = "") -> dict[str, float]:
    """The values with alpha > 0, by a name that begins with `prefix`."""
    return name_values(values.sel(alpha=values["alpha"] > 0), prefix + "alpha = {alpha:g}")
