"""Rates of errors and bounds against the number of unknowns, on uniform meshes and on adapted ones."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rates_over(errors: xr.Dataset, factor: float) -> xr.Dataset:
    """Rates from each level to the first with at least `factor` times its unknowns; NaN where there is none.

    `asymptotic` is 1 where the case declares errors on meshes of that size asymptotic; rates of errors are
    given from there on. `index` is the bound over the error, and `share` the algebraic bound over the error.
    """
    errors = errors.transpose("case", "kind", "level")
    N, order = errors["unknowns"].values, ("case", "kind", "level")
    later = np.argmax(N[..., None, :] >= factor * N[..., None], axis=-1)
    rates = {name: (order, _rate(N, errors[name].values, later)) for name in ("h1_error", "h1_bound")}
    found = xr.Dataset(rates, coords=errors.coords)
    asymptotic = errors["unknowns"] >= errors["asymptotic_from"]
    return xr.Dataset(
        {
            "error_rate": found["h1_error"].where(asymptotic),
            "bound_rate": found["h1_bound"],
            "asymptotic": asymptotic.astype(float),
            "index": errors["h1_bound"] / errors["h1_error"],
            "share": errors["algebraic_bound"] / errors["h1_error"],
        }
    )


def _rate(N: Array, values: Array, later: NDArray[np.intp]) -> Array:
    """(case, kind, level) rates: the fall of values against the growth of N; NaN where `later` is 0."""
    fall, growth = (np.log(np.take_along_axis(of, later, axis=-1) / of) for of in (values, N))
    return np.where(later > 0, -fall / np.where(later > 0, growth, 1.0), np.nan)
