"""What a stated accuracy will take, from the first levels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from unilateral.accuracy.budget import LARGEST_STEP, MARGIN, most_unknowns, observed_rate, sizes_and_bounds
from unilateral.accuracy.cost import Prospect
from unilateral.accuracy.level import Level

PROBE, KNOWN = 1.5, 400
"""Seconds, with those of the next level, and unknowns from which on the first levels are enough."""
UNEVEN = 1.4
"""Times the triangles of the best distribution: by marking, 1.2, and by the last step, which overshoots."""
STEP = 1.7
"""Times the unknowns of the adapted level before, on the average."""
OF_LAMBDA = 0.75
"""Rate of its bound in unknowns on adapted meshes: that of H^{3/2}, and 0.82 was observed."""
VAST = 1e30
"""Times the error that is wanted: more is not told apart, and its powers are numbers."""


@dataclass(frozen=True)
class Plan:
    """Unknowns of the finest mesh, seconds from the beginning, and MB; limits that do not allow it."""

    adapted: bool
    unknowns: int
    seconds: float
    peak_mb: float
    missed: tuple[str, ...]


def plan(prospect: Prospect) -> Plan | None:
    """None where nothing can be said: the size of the solution or of the error is not known at all."""
    last, sizes = prospect.done[-1], _sizes(prospect)
    if sizes is None:
        return None
    unknowns = max([last.unknowns, *sizes])
    seconds = prospect.elapsed + sum(map(prospect.seconds, sizes))
    missed = [name for name, most in most_unknowns(prospect).items() if sizes and most < unknowns]
    if seconds > last.goal.max_seconds:
        missed.append(f"max_seconds={last.goal.max_seconds:g}")
    return Plan(
        prospect.adapted, round(unknowns), seconds, prospect.mb(unknowns), tuple(dict.fromkeys(missed))
    )


def enough(prospect: Prospect) -> bool:
    """Whether the levels done are, for a plan."""
    sizes = _sizes(prospect)
    to_come = prospect.seconds(sizes[0]) if sizes else 0.0
    spent = sum(level.seconds for level in prospect.done)
    return prospect.done[-1].unknowns >= KNOWN and spent + to_come >= PROBE


def _needed(prospect: Prospect) -> float:
    """The unknowns of the last mesh, infinite if unknown.

    m triangles with the shares s of the squared bound, cut into K in all, have at best the squared bound
    sum(s^{1/2})^2 / K. Uniform meshes are taken to go on with the rate that was observed.
    """
    last = prospect.done[-1]
    wanted, s = _wanted(last), last.solved.shares
    if wanted <= 0 or not math.isfinite(last.total):
        return math.inf
    times = min(last.total / wanted, VAST)
    if prospect.adapted and last.goal.norm == "hm12":
        return last.unknowns * times ** (1 / OF_LAMBDA)
    if prospect.adapted:
        best = float(np.sqrt(s).sum() ** 2 / (len(s) * s.sum()))
        return last.unknowns * times**2 * UNEVEN * best
    rate = observed_rate(*sizes_and_bounds(prospect.done))
    return last.unknowns * (times / MARGIN) ** (2 / (1.0 if math.isnan(rate) else rate))


def _wanted(last: Level) -> float:
    """The error that will be wanted: of ||u||, taken to be ||u_h||, less that error itself."""
    goal, solved = last.goal, last.solved
    size = solved.u_norm if goal.norm == "h1" else solved.lambda_norm
    return goal.accuracy if goal.absolute else goal.accuracy * size / (1 + goal.accuracy)


def _sizes(prospect: Prospect) -> list[float] | None:
    """The unknowns of the levels that are still to come, None if unknown."""
    last, needed = prospect.done[-1], _needed(prospect)
    if last.certified or not math.isfinite(needed):
        return [] if last.certified else None
    step = STEP if prospect.adapted else LARGEST_STEP**2
    count = max(math.ceil(math.log(needed / last.unknowns, step)), 1)
    return [*(last.unknowns * step**k for k in range(1, count)), max(needed, last.unknowns)]
