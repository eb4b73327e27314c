"""The table behind the work-precision diagrams: fronts, lines at fixed H/h, and what explains them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.study.judge import cost as trade
from unilateral.study.judge.rates import NORMS
from unilateral.study.runs.cost.variants import Variant

COLUMNS = (
    "kind",
    "norm",
    "label",
    "H_over_h",
    "h",
    "H",
    "unknowns",
    "stop",
    "work",
    "error",
    "steps",
    "slope",
    "excess",
)
"""Of the table behind the figure."""
UNFITTED = ("barzilai_borwein", "newton")
"""Algorithms whose steps follow no power of H: they change with rounding, or are a few."""


def work_frame(
    crossed: xr.Dataset, cases: xr.Dataset, algebra: xr.Dataset, H_over_h: float, coarsest: float
) -> pd.DataFrame:
    """One row per point of the work-precision figure.

    kind front: work and relative error in a norm that no cheaper run beats; line: those of the cheapest
    algorithm at a fixed H/h and the level that is enough; steps: of an algorithm to the level SHOWN, with
    the fitted exponent;
    step: work of one, or of the set-up, by matrix; stop: the largest excess at a level.
    """
    parts = []
    for norm in NORMS:
        at = trade.best(crossed, norm, trade.enough(cases.isel(case=[0]), norm, coarsest))
        lines = at.to_dataframe().reset_index().dropna()
        worst = trade.excess(cases.sel(H=cases["H"] <= coarsest), norm).max(["case", "H_over_h", "H"])
        stops = pd.DataFrame({"kind": "stop", "stop": worst["stop"], "excess": worst})
        parts += [
            each.assign(norm=norm) for each in (_front(crossed, norm), lines.assign(kind="line"), stops)
        ]
    for algorithm in crossed["algorithm"].values:
        steps = crossed["steps"].sel(H_over_h=H_over_h, algorithm=algorithm)
        last = steps.sel(stop=trade.SHOWN, method="nearest")
        fitted = algorithm not in UNFITTED
        slope = round(trade.growth(crossed, algorithm, H_over_h, coarsest), 1) if fitted else np.nan
        line = {"kind": "steps", "label": algorithm, "H": last["H"], "steps": last, "slope": slope}
        parts.append(pd.DataFrame(line))
    lines = {name: algebra["step_operations"].sel(algebra=name) for name in algebra["algebra"].values}
    lines |= {f"setup_{name}": algebra["setup_operations"].sel(algebra=name) for name in ("S", "A")}
    for label, values in lines.items():
        unknowns = algebra["unknowns"].sel(algebra="S")
        parts.append(pd.DataFrame({"kind": "step", "label": label, "unknowns": unknowns, "work": values}))
    return pd.concat(parts, ignore_index=True)[list(COLUMNS)]


def in_seconds(
    crossed: xr.Dataset, algebra: xr.Dataset, timings: xr.Dataset, base: Variant, axes: Sequence[str]
) -> tuple[xr.Dataset, xr.Dataset]:
    """The same tables with seconds in the place of operations."""
    seconds, of_matrix = trade.along(timings, base, axes), trade.along(timings, base, ["algebra"])
    step, setup = of_matrix["seconds_per_step"], of_matrix["setup_seconds"]
    return (
        crossed.assign(operations=seconds["seconds"]),
        algebra.assign(step_operations=step, setup_operations=setup),
    )


def _front(crossed: xr.Dataset, norm: str) -> pd.DataFrame:
    crossed = crossed.sel(stop=crossed["stop"] < 1)
    of = {"error": trade.relative(crossed, norm), "work": crossed["operations"], "h": crossed["h"]}
    points = xr.Dataset(of).to_dataframe().reset_index().rename(columns={"algorithm": "label"})
    kept = points.iloc[trade.front(points["work"].to_numpy(), points["error"].to_numpy())]
    return kept.assign(kind="front")
