"""Tables along levels, and rates between these."""

from __future__ import annotations

import numpy as np
import xarray as xr

from unilateral.arrays import Array

GradedRow = dict[str, float]


def rates_by_halving(error: xr.DataArray) -> xr.DataArray:
    """Rates over (pair) from each level to the next, on which the mesh before grading has half the edges."""
    return (-xr.ufuncs.log2(error).diff("level", label="lower")).rename(level="pair")


def orders_between_levels(unknowns: Array, values: Array, factor: float) -> Array:
    """Orders (p,) in N^{-1/2} between each level and the first with at least `factor` times the unknowns.

    `unknowns` and `values` are (k,) of levels, coarse to fine; levels beyond the last are NaN.
    """
    is_level = np.isfinite(unknowns)
    N = unknowns[is_level]
    errors = values[is_level]
    first = [int(np.argmax(factor * n <= N)) for n in N]
    # e ~ (N^{-1/2})^p: p = 2 log(e_i / e_j) / log(N_j / N_i)
    pairs = [(i, j) for i, j in enumerate(first) if j]
    return np.array([2 * np.log(errors[i] / errors[j]) / np.log(N[j] / N[i]) for i, j in pairs])
