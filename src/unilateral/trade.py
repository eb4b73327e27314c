"""What the study of cost says: error against work, the growth of the steps, when to stop, what to use.

Errors are relative to ||u||_1, ||lambda||_{-1/2}, ||lambda||_0; in H^{-1/2} they are r.m.s. means of bounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from unilateral import operations
from unilateral.surfaces import predicted
from unilateral.tables import error_in
from unilateral.variants import Variant

Array = NDArray[np.float64]
ENOUGH = 1.1
"""An error that much larger than the discrete solution's is still good enough."""
GAIN = 0.98
"""Points of a front whose error is not below that part of the one before are left out."""
ALPHA = 0.5
"""lambda ~ s_+^alpha in the base case: what the rates of its best approximation depend on."""
LAST = (1e-5, 1e-10)
"""Levels between which the growth of the steps is measured, away from the start."""
SHOWN = 1e-6
"""The level to which steps are shown: further down rounding changes Barzilai and Borwein's, at H = 2h."""
CLOSE = 1.05
"""Ratios H/h whose error at the same work is at most that much larger than the best one's are as good."""
NORM_OF = {"h1": "u_norm", "l2": "l2_norm"}


class Choice(NamedTuple):
    """What to use for an error in a norm; relative error and operations are those on the finest mesh.

    `losses` are the errors at the same work of each H/h over those of the best; the rest is at the given one.
    `set_by` are the cases that need as low a stop, and `stop_elsewhere` is enough for the others.
    `halving` is the fitted factor of work for half of the error, `theory` that of work ~ h^-3 with the
    rate of the best approximation; `of_algorithms` the work of each there, over the least.
    """

    losses: dict[float, float]
    stop: float
    set_by: tuple[str, ...]
    stop_elsewhere: float
    h: float
    error: float
    operations: float
    halving: float
    theory: float
    of_algorithms: dict[str, float]


def along(table: xr.Dataset, base: Variant, axes: Sequence[str]) -> xr.Dataset:
    """The runs that differ from the base in these fields only, over them, H and the stopping level."""
    others = [name for name in Variant._fields if name not in axes]
    kept = np.logical_and.reduce([table[name].values == getattr(base, name) for name in others])
    runs = table.isel(run=np.flatnonzero(kept))
    labels = [pd.unique(runs[name].values) for name in axes]
    H = np.unique(runs["H"].values)[::-1]
    places = [
        np.array([list(label).index(x) for x in runs[name].values])
        for name, label in zip(axes, labels, strict=True)
    ]
    index = (*places, np.searchsorted(-H, -runs["H"].values))
    shape, dims = (*map(len, labels), len(H)), (*axes, "H")
    found: dict[str, Any] = {}
    for name, variable in runs.data_vars.items():
        if name in Variant._fields or name == "H":
            continue
        values = np.full((*shape, *variable.shape[1:]), np.nan)
        values[index] = variable.values
        found[str(name)] = ((*dims, *variable.dims[1:]), values)
    coords = {**dict(zip(axes, labels, strict=True)), "H": H, "stop": table["stop"].values}
    return xr.Dataset(found, coords=coords)


def relative(table: xr.Dataset, norm: str) -> xr.DataArray:
    """The errors over the norm of u or lambda."""
    return error_in(table, norm) / _mean(table, "hm12_norm", NORM_OF.get(norm))


def excess(table: xr.Dataset, norm: str) -> xr.DataArray:
    """The errors over those of the discrete solution."""
    return error_in(table, norm) / _mean(
        table, "hm12_discrete", None if norm == "hm12" else f"{norm}_discrete"
    )


def _mean(table: xr.Dataset, bounds: str, name: str | None) -> xr.DataArray:
    if name:
        return table[name]
    return (0.5 * (table[f"{bounds}_lower"] ** 2 + table[f"{bounds}_upper"] ** 2)) ** 0.5


def front(work: Array, error: Array) -> NDArray[np.intp]:
    """(k,) the points that no cheaper one beats, with a gain each, by rising work; NaN takes no part."""
    kept, least = [], np.inf
    for i in np.lexsort((error, work)):
        if np.isfinite(work[i]) and error[i] < GAIN * least:
            kept.append(int(i))
            least = error[i]
    return np.array(kept, dtype=np.intp)


def growth(crossed: xr.Dataset, algorithm: str, H_over_h: float, coarsest: float) -> float:
    """The exponent p of steps ~ H^-p, for the last five digits, by least squares over H <= `coarsest`."""
    steps = crossed["steps"].sel(algorithm=algorithm, H_over_h=H_over_h)
    last, first = (steps.sel(stop=level, method="nearest") for level in LAST[::-1])
    digits = last - first
    digits = digits[(crossed["H"].values <= coarsest) & np.isfinite(digits.values)]
    return float(-np.polyfit(np.log(digits["H"]), np.log(digits), 1)[0])


def enough(cases: xr.Dataset, norm: str, coarsest: float) -> float:
    """The largest stopping level that leaves no error above ENOUGH times the discrete solution's."""
    of = excess(cases.where(cases["H"] <= coarsest, drop=True), norm)
    worst = of.max([name for name in of.dims if name != "stop"])
    good = worst.values <= ENOUGH
    first = int(np.argmax(np.logical_and.accumulate(good[::-1])[::-1]))
    return float(worst["stop"][first]) if good[-1] else np.nan


def halving(work: Array, error: Array) -> float:
    """The factor of work for half of the error ~ work^-p, p by least squares; inf where it does not fall."""
    known = np.isfinite(work) & np.isfinite(error)
    p = -float(np.polyfit(np.log(work[known]), np.log(error[known]), 1)[0])
    return 2 ** (1 / p) if p > 0 else np.inf


def best(crossed: xr.Dataset, norm: str, stop: float) -> xr.Dataset:
    """Over (H_over_h, H), of the cheapest algorithm at that level: work, relative error and h."""
    at = crossed.sel(stop=stop)
    cheapest_one = at["operations"].fillna(np.inf).argmin("algorithm")
    found = xr.Dataset({"work": at["operations"], "error": relative(at, norm), "h": at["h"]})
    return found.isel(algorithm=cheapest_one).drop_vars("algorithm")


def losses(cases: xr.Dataset, norm: str) -> dict[float, float]:
    """Of each H/h, the geometric mean of error * work^(rate/3) over cases and sizes, over the least one.

    Errors are the discrete solution's, work is the set-up, most of it whatever the algorithm. The exponent,
    from work ~ h^-3, makes meshes comparable. A ratio takes part if it has three sizes, all by the same ones.
    """
    rate = float(predicted(norm, ALPHA))
    error = relative(cases, norm) / excess(cases, norm)
    score = xr.apply_ufunc(np.log, error.isel(stop=-1) * cases["setup_operations"] ** (rate / 3))
    enough_sizes = (score.count("H") >= 3).all("case")
    mean = score.sel(H_over_h=enough_sizes).dropna("H").mean(["case", "H"])
    over = np.exp(mean - mean.min()).sortby("H_over_h")
    return dict(zip(over["H_over_h"].values.tolist(), over.values.tolist(), strict=True))


def choice(crossed: xr.Dataset, cases: xr.Dataset, norm: str, H_over_h: float, coarsest: float) -> Choice:
    """Over H <= `coarsest`, all stopped where `enough` says, with the cheapest algorithm on each mesh."""
    stop, rate = enough(cases, norm, coarsest), float(predicted(norm, ALPHA))
    by_case = {str(name): enough(cases.sel(case=[name]), norm, coarsest) for name in cases["case"].values}
    fine = crossed.sel(H=crossed["H"] <= coarsest)
    at = best(fine, norm, stop)
    of = at.sel(H_over_h=H_over_h).dropna("H")
    last = of.isel(H=-1)
    work = fine["operations"].sel(stop=stop, H_over_h=H_over_h, H=last["H"]) / last["work"]
    return Choice(
        losses(cases.sel(H=cases["H"] <= coarsest), norm),
        stop,
        tuple(name for name, own in by_case.items() if own == stop),
        min((own for own in by_case.values() if own != stop), default=stop),
        last["h"].item(),
        last["error"].item(),
        last["work"].item(),
        halving(of["work"].values, of["error"].values),
        2 ** (3 / rate),
        {str(name): float(work.sel(algorithm=name)) for name in fine["algorithm"].values},
    )


def cheapest(crossed: xr.Dataset, norm: str, target: float) -> dict[str, Any] | None:
    """The run and level below 1 of least work with a relative error of at most `target`, if there is one."""
    crossed = crossed.sel(stop=crossed["stop"] < 1)
    error, work = relative(crossed, norm), crossed["operations"]
    good = work.where(error <= target)
    if not bool(good.notnull().any()):
        return None
    place = good.fillna(np.inf).argmin(...)
    at, names = crossed[["h", "operations"]].isel(place), ("algorithm", "H_over_h", "stop", "h", "operations")
    return {**{name: at[name].item() for name in names}, "error": float(error.isel(place))}


def breaks_even(algebra: xr.Dataset) -> Array:
    """(H,) the steps after which forming S has paid, against solves with A; the spectrum is not counted.

    With A, too, rho and the guaranteed stop need it, and there it is taken as given.
    """
    more = algebra["setup_operations"].sel(algebra="S") - algebra["setup_operations"].sel(algebra="A")
    cells = algebra["multipliers"].sel(algebra="S").values
    more = more - [operations.spectrum(int(m)) for m in cells]
    saved = algebra["step_operations"].sel(algebra="A") - algebra["step_operations"].sel(algebra="S")
    return (more / saved).values
