"""The consistency term <Pi_H lambda, u - g> of (4.16): by cell, in total, and as predicted.

For lambda = s_+^alpha and u - g = s_-^gamma, s in side lengths L from a transition, which lies at the
fraction theta of its cell, of length H,

    <Pi_H lambda, u - g> = L (H/L)^{alpha+gamma+1} theta^{gamma+1} (1-theta)^{alpha+1} / (alpha+1)/(gamma+1).
"""

from __future__ import annotations

from math import isclose
from typing import NamedTuple

import numpy as np

from unilateral.errors import InputError
from unilateral.geometry.partition import Partition
from unilateral.problems.case import Case
from unilateral.problems.polar_atoms import Polar


class Transition(NamedTuple):
    """The point where contact begins, t side lengths from the start of a side, and both exponents."""

    side: int
    t: float
    alpha: float
    gamma: float

    @property
    def rate(self) -> float:
        return self.alpha + self.gamma + 1


def first_transition(case: Case) -> Transition:
    """The transition at the case's harmonic atom. Raises InputError if there is none with a power as gap."""
    for atom in case.atoms:
        if isinstance(atom, Polar) and not atom.at_vertex:
            for t, gamma in case.gap_kinks[atom.side]:
                if isclose(t, atom.t, rel_tol=1e-12):
                    return Transition(atom.side, t, float(atom.beta) - 1, float(gamma))
    raise InputError(f"case '{case.name}' has no harmonic atom where its gap closes like a power")


def leading(transition: Transition, partition: Partition) -> tuple[float, float]:
    """The term of that transition alone, by the formula of this module, and theta."""
    polygon, (side, t, alpha, gamma) = partition.polygon, transition
    s = polygon.starts[side] + t * polygon.lengths[side]
    cell = int(np.searchsorted(partition.points, s, side="right")) - 1
    theta = float((s - partition.points[cell]) / partition.lengths[cell])
    size = float(partition.lengths[cell] / polygon.lengths[side])
    means = theta ** (gamma + 1) * (1 - theta) ** (alpha + 1) / ((alpha + 1) * (gamma + 1))
    return float(polygon.lengths[side]) * size**transition.rate * means, theta
