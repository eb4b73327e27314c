"""The floors of ||u - u_h||_1 over the whole (h, H) grid: error^2 = (C1 h)^2 + (C2 H^s)^2, fitted.

At fixed h the error does not fall below C1 h as H -> 0, at fixed H not below C2 H^s as h -> 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from study import tables
from study.tables import ZERO_ERROR_SHARE
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.formula import parse_real
from unilateral.problems import case

START_S = 1.5
"""The fit starts from this s, the rate of P0 in H^{-1/2} for a smooth lambda."""


def fit_floors(errors: str, name: str, ratio: object, floors: str) -> None:
    """Write the fits of a scene's errors, for asymptotic sizes as the cases declare them."""
    table = tables.load_table(errors)
    declared = {
        case_name: case.read_case_declaration(case_name)[0]["asymptotic"]["h1"]["from"]
        for case_name in table["case"].values
    }
    starts = {
        case_name: parse_real(start, f"case '{case_name}', asymptotic.h1.from")
        for case_name, start in declared.items()
    }
    fits = fit_cases(table, starts, parse_real(ratio, "judged_ratio"))
    tables.save_table(fits, floors, name, {"rates.judged_ratio": ratio})


class Floor(NamedTuple):
    """The fit; `residual` is its largest |log(error / model)|, `pairs` the number of errors."""

    C1: float
    C2: float
    s: float
    s_uncertainty: float
    residual: float
    pairs: int


def fit_floor(h: Array, H: Array, error: Array) -> Floor:
    """The fit of errors (k,) at sizes h, H (k,), by least squares of the logarithms.

    The uncertainty of s is its standard deviation, from the Jacobian and the residuals' variance. Raises
    InputError for fewer than four errors, or sizes that cannot tell the two terms apart.
    """
    if len(error) < 4 or len(np.unique(h)) < 2 or len(np.unique(H)) < 2:
        raise InputError(
            f"floors: {len(error)} errors at {len(np.unique(h))} h and {len(np.unique(H))} H; "
            "a fit needs four, at two of each"
        )
    start = np.array([np.log(np.min(error / h)), np.log(np.min(error / H**START_S)), START_S])
    fit = least_squares(
        _log_residuals, start, args=(np.log(h), np.log(H), np.log(error)), xtol=1e-14, ftol=1e-14, gtol=1e-14
    )
    # (J^T J)^{-1} times the variance of the residuals, by degrees of freedom: errors less parameters
    freedom = len(error) - len(start)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * (fit.fun @ fit.fun) / freedom
    C1, C2 = np.exp(fit.x[:2])
    uncertainty = np.sqrt(covariance[2, 2])
    largest = np.max(np.abs(fit.fun))
    return Floor(float(C1), float(C2), float(fit.x[2]), float(uncertainty), float(largest), len(error))


def _log_residuals(parameters: Array, log_h: Array, log_H: Array, log_error: Array) -> Array:
    log_C1, log_C2, s = parameters
    # log error = log((C1 h)^2 + (C2 H^s)^2) / 2
    model = 0.5 * np.logaddexp(2 * (log_C1 + log_h), 2 * (log_C2 + s * log_H))
    return np.asarray(model - log_error)


def fit_cases(errors: xr.Dataset, starts: Mapping[str, float], judged_ratio: float) -> xr.Dataset:
    """The fits by case, over its asymptotic sizes.

    These are as for rates: h, and H times `judged_ratio`, are at most the case's start. Cases with lambda = 0
    are left out, since no part of their error depends on H.
    """
    zero = errors["projection_error"].max("partition") <= ZERO_ERROR_SHARE * errors["u_norm"].max("mesh")
    cases = [str(case) for case in errors["case"].values if not zero.sel(case=case)]
    fits = [_fit_case(errors.sel(case=case), starts[case], judged_ratio) for case in cases]
    table = {name: ("case", [getattr(fit, name) for fit in fits]) for name in Floor._fields}
    return xr.Dataset(table | {"start": ("case", [starts[case] for case in cases])}, coords={"case": cases})


def _fit_case(errors: xr.Dataset, start: float, judged_ratio: float) -> Floor:
    error = errors["h1_error"].transpose("mesh", "partition").values
    h, H = np.broadcast_arrays(errors["h"].values[:, None], errors["H"].values[None])
    counts = np.isfinite(error) & (np.maximum(h, H * judged_ratio) <= start * (1 + 1e-9))
    return fit_floor(h[counts], H[counts], error[counts])
