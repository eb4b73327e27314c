"""What the study of cost says: error against work, the growth of the steps, when to stop, what to use.

Errors are relative to ||u||_1, ||lambda||_{-1/2}, ||lambda||_0; in H^{-1/2} they are r.m.s. means of bounds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from study import operations
from study.tables import error_in_norm
from unilateral.arrays import Array, Index

ENOUGH_FACTOR = 1.1
"""An error of this many times the discrete solution's is still good enough."""
MAX_FRONT_QUOTIENT = 0.98
"""Points of a front are left out if their error is not below this part of the error before."""
COMPARED_LEVEL = 1e-6
"""Steps to this level are compared. Below it rounding changes those of Barzilai and Borwein, at H = 2h."""
MIN_SIZES = 3
"""The growth of steps needs so many H, and a line of errors over work one more."""
N_WORK_VALUES = 256
"""Lines of errors are compared at so many values of the work."""


class Price(NamedTuple):
    """The price of an error in a norm on the finest mesh.

    `stop` is the level that is enough, and `error` is relative. `operations` are Uzawa's, and `over_setup` is
    their quotient by those of the set-up. `halving` is the fitted factor of work for half of the
    error.
    """

    stop: float
    h: float
    error: float
    operations: float
    over_setup: float
    halving: float


def relative_errors(table: xr.Dataset, norm: str, quantity: str = "error") -> xr.DataArray:
    """The errors, or those of the discrete solution, over the norm of u or lambda."""
    exact_norm = table["u_norm"] if norm == "h1" else error_in_norm(table, norm, quantity="norm")
    return error_in_norm(table, norm, quantity=quantity) / exact_norm


def error_excess(table: xr.Dataset, norm: str) -> xr.DataArray:
    """The errors over those of the discrete solution."""
    return error_in_norm(table, norm) / error_in_norm(table, norm, quantity="discrete")


def pareto_front(work: Array, error: Array) -> Index:
    """Indices (k,) of the points that no cheaper one beats, each with a gain, by rising work."""
    front = []
    smallest_error = np.inf
    for i in np.lexsort((error, work)):
        if np.isfinite(work[i]) and error[i] < MAX_FRONT_QUOTIENT * smallest_error:
            front.append(int(i))
            smallest_error = error[i]
    return np.array(front, dtype=np.intp)


def growth_exponent(crossed: xr.Dataset, algorithm: str, H_over_h: float, coarsest: float) -> float:
    """The exponent p of steps ~ H^-p to the compared level, by least squares over H <= `coarsest`.

    NaN with fewer than three such H.
    """
    steps = (
        crossed["steps"]
        .sel(algorithm=algorithm, H_over_h=H_over_h)
        .sel(stop=COMPARED_LEVEL, method="nearest")
    )
    steps = steps[(crossed["H"].values <= coarsest) & np.isfinite(steps.values)]
    if steps.size < MIN_SIZES:
        return np.nan
    return float(-np.polyfit(np.log(steps["H"]), np.log(steps), 1)[0])


def sufficient_stop(cases: xr.Dataset, norm: str, coarsest: float) -> float:
    """The largest stopping level below 1 that leaves all errors at most 1.1 times the discrete solution's."""
    excess = error_excess(cases.sel(H=cases["H"] <= coarsest, stop=cases["stop"] < 1), norm)
    worst = excess.max([name for name in excess.dims if name != "stop"])
    # Levels fall: from the first good one on all have to be good
    good = worst.values <= ENOUGH_FACTOR
    first = int(np.argmax(np.logical_and.accumulate(good[::-1])[::-1]))
    return float(worst["stop"][first]) if good[-1] else np.nan


def halving_factor(work: Array, error: Array) -> float:
    """The factor of work that halves the error ~ work^-p, p by least squares; inf if it does not fall."""
    finite = np.isfinite(work) & np.isfinite(error)
    # error ~ work^-p: half of it takes 2^(1/p) times the work
    p = -float(np.polyfit(np.log(work[finite]), np.log(error[finite]), 1)[0])
    return 2 ** (1 / p) if p > 0 else np.inf


def cheapest_at_level(crossed: xr.Dataset, norm: str, stop: float) -> xr.Dataset:
    """The work, relative error and h of the cheapest algorithm at that level, over (H_over_h, H)."""
    level_runs = crossed.sel(stop=stop)
    cheapest = level_runs["operations"].fillna(np.inf).argmin("algorithm")
    runs = xr.Dataset(
        {"work": level_runs["operations"], "error": relative_errors(level_runs, norm), "h": level_runs["h"]}
    )
    return runs.isel(algorithm=cheapest).drop_vars("algorithm")


def losses_by_ratio(error: xr.DataArray, work: xr.DataArray) -> dict[float, float]:
    """The mean error of each H/h over that of the best one, at the same work.

    `error` and `work` are over (H_over_h, H). Between meshes log error is linear in log work; its mean is
    over the works that all ratios reach with more than three H.
    """
    lines: dict[float, tuple[Array, Array]] = {}
    for ratio in error["H_over_h"].values:
        x = np.log(work.sel(H_over_h=ratio).values)
        y = np.log(error.sel(H_over_h=ratio).values)
        finite = np.isfinite(x) & np.isfinite(y)
        if np.count_nonzero(finite) > MIN_SIZES:
            lines[float(ratio)] = (x[finite], y[finite])
    first = max(x.min() for x, _ in lines.values())
    last = min(x.max() for x, _ in lines.values())
    common = np.linspace(first, last, N_WORK_VALUES)
    # The mean of log error over the common range of log work, for each H/h, less the least of these
    means = {ratio: float(np.mean(np.interp(common, x, y))) for ratio, (x, y) in sorted(lines.items())}
    return {ratio: float(np.exp(mean - min(means.values()))) for ratio, mean in means.items()}


def price_at_level(runs: xr.Dataset, norm: str, stop: float, coarsest: float) -> Price:
    """Price of an error at a level, by runs over (H, stop) with H <= `coarsest`."""
    levels = runs.sel(H=runs["H"] <= coarsest, stop=stop).dropna("H", subset=["operations"])
    error = relative_errors(levels, norm)
    finest = levels.isel(H=-1)
    work = finest["operations"].item()
    return Price(
        stop=stop,
        h=finest["h"].item(),
        error=error.values[-1].item(),
        operations=work,
        over_setup=work / finest["setup_operations"].item(),
        halving=halving_factor(levels["operations"].values, error.values),
    )


def cheapest_run(crossed: xr.Dataset, norm: str, target: float) -> dict[str, float] | None:
    """Uzawa's run and level below 1 of least work with at most this relative error, if there is one."""
    runs = crossed.sel(algorithm="uzawa", stop=crossed["stop"] < 1)
    error = relative_errors(runs, norm)
    work = runs["operations"]
    good = work.where(error <= target)
    if not bool(good.notnull().any()):
        return None
    place = good.fillna(np.inf).argmin(...)
    cheapest = runs[["h", "operations"]].isel(place)
    names = ("H_over_h", "stop", "h", "operations")
    return {**{name: cheapest[name].item() for name in names}, "error": float(error.isel(place))}


def break_even_steps(algebra: xr.Dataset) -> Array:
    """Steps, by H, after which forming S has paid, against solves with A; the spectrum is not counted.

    With A, too, rho and the guaranteed stop need the spectrum, and there it is taken as given.
    """
    extra_setup = algebra["setup_operations"].sel(algebra="S") - algebra["setup_operations"].sel(algebra="A")
    cells = algebra["multipliers"].sel(algebra="S").values
    # Steps n with extra set-up = n (a step with A - a step with S)
    extra_setup = extra_setup - [operations.count_spectrum(int(m)) for m in cells]
    saved = algebra["step_operations"].sel(algebra="A") - algebra["step_operations"].sel(algebra="S")
    return (extra_setup / saved).values


def work_of_A_over_S(
    algebra: xr.Dataset, crossed: xr.Dataset, algorithm: str, H_over_h: float
) -> xr.DataArray:
    """Operations of a run whose steps solve with A over those with S, by (H, stop).

    Both are without the spectrum and the checks of the bound, that is, without the guarantee.
    """
    runs = crossed.sel(algorithm=algorithm, H_over_h=H_over_h)
    run_by_A = algebra.sel(algebra="A")
    spectrum = xr.apply_ufunc(operations.count_spectrum, runs["multipliers"])
    residuals = runs["steps"] + 1
    by_S = runs["setup_operations"] - spectrum + residuals * runs["step_operations"]
    return (run_by_A["setup_operations"] + residuals * run_by_A["step_operations"]) / by_S
