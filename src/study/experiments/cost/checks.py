"""Checks of what accuracy costs: the growth of the steps, the stop that is enough, the price of a step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from study.evidence import Evidence, Tables, pick_worst, require_preconditions
from study.experiments.cost import trade


def relative_step_growth(
    tables: Tables, algorithm: str, reference: str, coarsest: float, at_most: float
) -> Evidence:
    """The growth of an algorithm's steps to the last level, from one H to the next, over another one's."""
    steps = tables["cost/algorithm"]["steps"].isel(stop=-1)
    share = steps.sel(algorithm=algorithm, H=steps["H"] <= coarsest) / steps.sel(algorithm=reference)
    rows: dict[str, float] = {}
    for ratio in share["H_over_h"].values:
        data = share.sel(H_over_h=ratio).dropna("H")
        factors = data.values[1:] / data.values[:-1]  # from one H to the next
        rows |= {
            f"H/h = {ratio:g}, H = {H:g}": float(f)
            for H, f in zip(data["H"].values[1:], factors, strict=True)
        }
    return pick_worst(rows, f"growth of the steps of {algorithm} over that of {reference}", at_most, False)


def stop_is_enough(tables: Tables, norm: str, stop: float, coarsest: float, at_most: float) -> Evidence:
    """The largest relative excess, for any H/h, of the error at a level over the discrete solution's."""
    cases = tables["cost/case"]
    fine = cases.sel(H=cases["H"] <= coarsest)
    excess = trade.error_excess(fine, norm).sel(stop=stop)
    largest = excess.max(["H", "H_over_h"])
    rows = {str(name): float(largest.sel(case=name)) - 1 for name in largest["case"].values}
    quantity = f"error at the level {stop:g} over that of the discrete solution, less 1"
    short = fine["setup_operations"].notnull() & excess.isnull()
    faults = [
        f"a run of {name} does not reach the level {stop:g}"
        for name in short["case"].values
        if short.sel(case=name).any()
    ]
    return require_preconditions(pick_worst(rows, quantity, at_most, False), faults)


def enough_but_for(tables: Tables, norm: str, stop: float, coarsest: float, cases: Sequence[str]) -> Evidence:
    """1 for each named case for which a level is enough, and each other case for which it is not; else 0."""
    table = tables["cost/case"]
    rows = {}
    for name in table["case"].values:
        enough = trade.sufficient_stop(table.sel(case=name), norm, coarsest) >= stop
        rows[str(name)] = float(enough == (name in cases))
    return pick_worst(rows, f"cases that the level {stop:g} parts otherwise", 0.0, False)


def elimination_pays(
    tables: Tables, many_steps: str, few_steps: str, H_over_h: float, stop: float
) -> Evidence:
    """The work by A over that by S for the algorithm of many steps, and its inverse for that of few.

    Both are on the finest mesh.
    """
    share = {
        name: float(
            trade.work_of_A_over_S(tables["cost/algebra"], tables["cost/algorithm"], name, H_over_h)
            .sel(stop=stop)
            .isel(H=-1)
        )
        for name in (many_steps, few_steps)
    }
    rows = {many_steps: share[many_steps], few_steps: 1 / share[few_steps]}
    return pick_worst(rows, "work by $A$ over that by $S$ with many steps, its inverse with few", 1.0, True)


def step_economy(tables: Tables, at_least: float) -> Evidence:
    """Operations of a step with A over those with S: their growth over that of log n, mesh by mesh.

    Raises Unjudged unless both take the same steps.
    """
    algebra = tables["cost/algebra"]
    share = algebra["step_operations"].sel(algebra="A") / algebra["step_operations"].sel(algebra="S")
    # Nested dissection: a solve with A takes O(n log n) operations, a product with S O(m^2) = O(n)
    over_log = share.values / np.log(algebra["unknowns"].sel(algebra="S").values)
    rows = {
        f"h = {h:g}": float(growth)
        for h, growth in zip(algebra["h"].sel(algebra="S")[1:], over_log[1:] / over_log[:-1], strict=True)
    }
    quantity = (
        r"growth of the operations with $A$ over those with $S$, over that of $\log n$, for half of $h$"
    )
    with_A = algebra["steps"].sel(algebra="A")
    with_S = algebra["steps"].sel(algebra="S")
    ran = np.isfinite(with_A)
    same = bool(ran.any()) and bool((with_A == with_S).where(ran, True).all())
    faults = [] if same else ["steps with A are not known to be as many as those with S"]
    return require_preconditions(pick_worst(rows, quantity, at_least, True), faults)
