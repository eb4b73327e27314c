"""The next level: uniform or adapted, the size at which its bound should be small enough, and the budget."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from unilateral.accuracy.level import Level, standing, unknowable
from unilateral.geometry.adapted import BULK
from unilateral.memory import available_mb

MARGIN = 0.9
"""Of the error that is wanted: what the next level aims at."""
LEAST_STEP, LARGEST_STEP = 1.25, 4.0
"""Between the sizes of two levels."""
RATES = (0.25, 2.0)
"""Within which an observed rate is believed."""
GUESS = 1.05
"""More unknowns than h^-2 predicts, which gmsh may make."""
WORTH, ENOUGH = 1.5, 200
"""1 is seen where solutions vary alike everywhere; and unknowns below which all meshes cost alike."""
SPARE = 0.8
"""Of the memory that is free: what the next level may take, beside what the last one still holds."""
GROWTH = 1.3
"""Seconds and memory grow like the unknowns to this power, at most."""


def wanted(done: Sequence[Level]) -> bool:
    """Whether another level is, after these."""
    last = done[-1]
    over = last.certified or not last.solved.result.converged or unknowable(last)
    return not over and len(standing(done)) == len(done)


def affordable_H(done: Sequence[Level], seconds: float) -> float | None:
    """The next level's H within the budget, of which so many seconds are spent, or None."""
    last, share = done[-1], max(_shares(done[-1], seconds).values())
    if not wanted(done) or LEAST_STEP * share > 1:
        return None
    H = last.partition.H
    aim = wanted_H([level.partition.H for level in done], [level.total for level in done], last.target)
    return max(aim, H * share)


def affordable(last: Level, unknowns: int, seconds: float) -> bool:
    """Whether a next level with so many unknowns is within the budget."""
    return math.sqrt(last.unknowns / unknowns) >= max(_shares(last, seconds).values())


def refinement_pays(last: Level) -> bool:
    """Whether uniform meshes need more than WORTH times the unknowns of adapted ones, by the bound's parts.

    A triangle with the share s of the squared bound, cut into k, has s / k. With m triangles cut into K in
    all that is m sum(s) / K for equal k, and for the best, k like s^{1/2}, sum(s^{1/2})^2 / K.
    """
    s = last.solved.shares
    return last.unknowns >= ENOUGH and bool(len(s) * s.sum() > WORTH * np.sqrt(s).sum() ** 2)


def bulk(last: Level) -> float:
    """Of the squared bound, what triangles are to have that are refined next: BULK, or what is enough.

    That is where the target is near, and their shares are taken to fall to a quarter.
    """
    return min(BULK, 4 / 3 * (1 - (MARGIN * last.target / last.total) ** 2))


def _shares(last: Level, seconds: float) -> dict[str, float]:
    """Of every limit, the part of a level's H to which it allows the next one to go down."""
    most, memory = last.goal.max_unknowns, min(last.goal.max_memory, SPARE * available_mb())
    left = last.goal.max_seconds - seconds
    return {
        f"max_unknowns={most:.0f}": math.sqrt(GUESS * last.unknowns / most),
        f"max_memory={memory:.0f}": (last.mb / memory) ** (0.5 / GROWTH),
        f"max_seconds={last.goal.max_seconds:g}": (
            (last.seconds / left) ** (0.5 / GROWTH) if left > 0 else math.inf
        ),
    }


def limits(done: Sequence[Level]) -> list[str]:
    """Those that do not allow a level after these."""
    shares = _shares(done[-1], sum(level.seconds for level in done))
    largest = max(shares.values())
    return [name for name, share in shares.items() if LEAST_STEP * share > 1 or share == largest]


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
