"""Checks of adapted meshes: rates against the number of unknowns, and how large the bound is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from study.evidence import Evidence, Tables, pick_worst, require_preconditions

MIN_ADAPTIVE_PAIRS = 3
"""A rate needs so many pairs of asymptotic levels; fewer say nothing about it."""


def adapted_rate(
    tables: Tables, table: str, cases: Sequence[str], variable: str, at_least: float, share: float
) -> Evidence:
    """The smallest rate on adapted meshes over all asymptotic pairs of levels.

    Raises Unjudged if it would pass, but a case has too few pairs, or the algebraic bound of an asymptotic
    level is more than that share of the error.
    """
    data = tables[table].sel(kind="adapted", case=list(cases))
    rates = {str(case): data[variable].sel(case=case).dropna("level").values for case in data["case"].values}
    faults = [
        f"{case} has {len(case_rates)} pairs"
        for case, case_rates in rates.items()
        if len(case_rates) < MIN_ADAPTIVE_PAIRS
    ]
    largest = float(data["share"].where(data["asymptotic"] == 1).max())
    if not largest <= share:
        faults.append(f"the algebraic bound is {largest:.2g} of an error")
    rows = {case: float(np.min(case_rates, initial=np.inf)) for case, case_rates in rates.items()}
    return require_preconditions(
        pick_worst(rows, "the smallest rate against the unknowns", at_least, True), faults
    )
