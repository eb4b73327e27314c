"""The size of the next level: where its bound should be small enough, and what the budget allows."""

from __future__ import annotations

import math
from collections.abc import Sequence

from unilateral.accuracy.level import Level, standing, unknowable
from unilateral.memory import available_mb

MARGIN = 0.9
"""Of the error that is wanted: what the next level aims at."""
LEAST_STEP, LARGEST_STEP = 1.25, 4.0
"""Between the sizes of two levels."""
RATES = (0.25, 2.0)
"""Within which an observed rate is believed."""
GUESS = 1.05
"""More unknowns than h^-2 predicts, which gmsh may make."""
GROWTH = 1.3
"""Seconds and memory grow like the unknowns to this power, at most."""


def affordable_H(done: Sequence[Level], seconds: float) -> float | None:
    """The next level's H within the budget, of which so many seconds are spent, or None."""
    last, in_time = done[-1], _in_time(done[-1], seconds)
    if last.certified or in_time == math.inf or not last.solved.result.converged or unknowable(last):
        return None
    if len(standing(done)) < len(done):
        return None
    H = last.partition.H
    wanted = wanted_H([level.partition.H for level in done], [level.total for level in done], last.target)
    affordable = H * max(*_shares(last).values(), in_time)
    if LEAST_STEP * affordable > H:
        return None
    return max(wanted, affordable)


def _shares(last: Level) -> dict[str, float]:
    """Of the limits to sizes, the part of a level's H to which each allows the next one to go down."""
    most, memory = last.goal.max_unknowns, min(last.goal.max_memory, available_mb())
    return {
        f"max_unknowns={most:.0f}": math.sqrt(GUESS * last.unknowns / most),
        f"max_memory={memory:.0f}": (last.mb / memory) ** (0.5 / GROWTH),
    }


def _in_time(last: Level, seconds: float) -> float:
    """The same for the time that is left."""
    left = last.goal.max_seconds - seconds
    return float((last.seconds / left) ** (0.5 / GROWTH)) if left > 0 else math.inf


def limits(done: Sequence[Level]) -> list[str]:
    """Those that do not allow a level after these."""
    last = done[-1]
    found = [name for name, share in _shares(last).items() if LEAST_STEP * share > 1]
    if LEAST_STEP * _in_time(last, sum(level.seconds for level in done)) > 1:
        found.append(f"max_seconds={last.goal.max_seconds:g}")
    return found or [f"max_unknowns={last.goal.max_unknowns:.0f}"]


def wanted_H(sizes: Sequence[float], bounds: Sequence[float], target: float) -> float:
    """The next level's H from those of the levels done and their bounds: where it should meet the target.

    Bounds are taken to fall at the rate of the last two; without two of them, or a target, H is halved.
    """
    H, bound = sizes[-1], bounds[-1]
    if len(sizes) < 2 or target <= 0 or not (math.isfinite(bounds[-2]) and math.isfinite(bound)):
        return H / 2
    observed = math.log(bounds[-2] / bound) / math.log(sizes[-2] / H)
    wanted = H * (MARGIN * target / bound) ** (1 / min(max(observed, RATES[0]), RATES[1]))
    return min(max(wanted, H / LARGEST_STEP), H / LEAST_STEP)
