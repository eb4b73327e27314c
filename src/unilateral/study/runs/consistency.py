"""The consistency term <Pi_H lambda, u - g> of (4.16): by cell, in total, and as predicted.

For lambda = s_+^alpha and u - g = s_-^gamma, s in side lengths L from a transition, which lies at the
fraction theta of its cell, of length H,

    <Pi_H lambda, u - g> = L (H/L)^{alpha+gamma+1} theta^{gamma+1} (1-theta)^{alpha+1} / (alpha+1)/(gamma+1).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isclose
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.errors import InputError
from unilateral.geometry.partition import Partition, uniform
from unilateral.norms.exact import cell_means
from unilateral.problems.case import Case
from unilateral.problems.polar import Polar


class Transition(NamedTuple):
    """Where contact begins, at t in side lengths of a side, with both exponents."""

    side: int
    t: float
    alpha: float
    gamma: float

    @property
    def rate(self) -> float:
        return self.alpha + self.gamma + 1


def first_transition(case: Case) -> Transition:
    """That of the case's harmonic atom. Raises InputError if it has none, or the gap no power there."""
    for atom in case.atoms:
        if isinstance(atom, Polar) and not atom.at_vertex:
            for t, gamma in case.gap_kinks[atom.side]:
                if isclose(t, atom.t, rel_tol=1e-12):
                    return Transition(atom.side, t, float(atom.beta) - 1, float(gamma))
    raise InputError(f"case '{case.name}' has no harmonic atom where its gap closes like a power")


def leading(transition: Transition, partition: Partition) -> tuple[float, float]:
    """The term of that transition alone, by the formula above, and theta."""
    polygon, (side, t, alpha, gamma) = partition.polygon, transition
    s = polygon.starts[side] + t * polygon.lengths[side]
    cell = int(np.searchsorted(partition.points, s, side="right")) - 1
    theta = float((s - partition.points[cell]) / partition.lengths[cell])
    size = float(partition.lengths[cell] / polygon.lengths[side])
    means = theta ** (gamma + 1) * (1 - theta) ** (alpha + 1) / ((alpha + 1) * (gamma + 1))
    return float(polygon.lengths[side]) * size**transition.rate * means, theta


def consistency_frame(
    case: Case, partition: Partition, studies: Sequence[tuple[Sequence[Case], xr.Dataset]]
) -> pd.DataFrame:
    """The cells of the side with the case's transition; and, over H, totals beside what is predicted.

    `studies` are cases with their scene's table of errors. The kind `elsewhere` is the part of a total that
    cells without a transition add; all terms stand in one column, so that they are rounded alike.
    """
    rows = [row for cases, errors in studies for each in cases for row in _totals(each, errors)]
    return pd.concat([_cells(case, partition), pd.DataFrame(rows)])


def _cells(case: Case, partition: Partition) -> pd.DataFrame:
    side, found = first_transition(case).side, cell_means(case, partition)
    here, start = partition.side == side, partition.polygon.starts[side]
    return pd.DataFrame(
        {
            "kind": "cell",
            "case": case.name,
            "H": partition.H,
            "s": partition.points[:-1][here] - start,
            "end": partition.points[1:][here] - start,
            "lambda_mean": found.lambda_means[here],
            "gap_mean": found.gap_means[here],
            "term": found.consistency_terms[here],
        }
    )


def _totals(case: Case, errors: xr.Dataset) -> list[dict[str, object]]:
    transition, of, rows = first_transition(case), errors.sel(case=case.name), []
    for k, H in enumerate(errors["H"].values):
        predicted, theta = leading(transition, uniform(case.polygon, H))
        terms = {
            "total": float(of["consistency"][k]),
            "elsewhere": float(of["consistency_elsewhere"][k]),
            "predicted": predicted,
        }
        same = {"case": case.name, "H": float(H), "theta": theta, "rate": transition.rate}
        rows += [{"kind": kind, **same, "term": term, "over_H2": term / H**2} for kind, term in terms.items()]
    return rows
