"""The next level: uniform or adapted, the size at which its bound should be small enough, and the budget."""

from __future__ import annotations

import math
from collections.abc import Sequence

from unilateral.accuracy.cost import Prospect
from unilateral.accuracy.level import Level, standing, unknowable, without_contact
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
SPARE = 0.8
"""Of the memory that is free: what the next level may take, beside what the last one still holds."""


CAUTION = 0.7
"""Of the unknowns that seconds or memory allow, for what they are predicted to be was right within 1.5."""


def wanted(done: Sequence[Level]) -> bool:
    """Whether another level is, after these."""
    last = done[-1]
    over = last.certified or not last.solved.result.converged or unknowable(last) or without_contact(last)
    return not over and len(standing(done)) == len(done)


def affordable_H(prospect: Prospect) -> float | None:
    """The next uniform level's H within the budget, or None.

    Where the budget does not allow what is wanted, the last level stays away from the limits.
    """
    done, H = prospect.done, prospect.done[-1].partition.H
    if not wanted(done):
        return None
    aim = wanted_H(*sizes_and_bounds(done), done[-1].target)
    if aim >= H * _share(prospect, min(most_unknowns(prospect).values())):
        return aim
    share = _share(prospect, min(most_unknowns(prospect, CAUTION).values()))
    return max(aim, H * share) if LEAST_STEP * share <= 1 else None


def sizes_and_bounds(done: Sequence[Level]) -> tuple[list[float], list[float]]:
    """H, and the bound, of each level."""
    return [level.partition.H for level in done], [level.total for level in done]


def affordable(prospect: Prospect, unknowns: int) -> bool:
    """Whether a level with so many unknowns is within the budget."""
    return unknowns <= min(most_unknowns(prospect).values())


def most_unknowns(prospect: Prospect, part: float = 1.0) -> dict[str, float]:
    """Of every limit, the unknowns that it allows the next level to have; that part where it is predicted."""
    goal = prospect.done[-1].goal
    (of_memory, mb), (of_time, seconds) = goal.memory(SPARE * available_mb()), goal.seconds
    return {
        f"max_unknowns={goal.unknowns:.0f}": goal.unknowns,
        of_memory: part * prospect.within_mb(mb),
        of_time: part * prospect.within_seconds(seconds),
    }


def _share(prospect: Prospect, most: float) -> float:
    """The part of the last level's H down to which the next one may go with so many unknowns."""
    return math.sqrt(GUESS * prospect.done[-1].unknowns / most) if most > 0 else math.inf


def bulk(last: Level) -> float:
    """Of the squared bound, what triangles are to have that are refined next: BULK, or what is enough.

    That is where the target is near, and their shares are taken to fall to a quarter.
    """
    return min(BULK, 4 / 3 * (1 - (MARGIN * last.target / last.total) ** 2))


def limits(prospect: Prospect) -> list[str]:
    """Those that do not allow a level after the last one."""
    most = most_unknowns(prospect)
    shares = {name: _share(prospect, unknowns) for name, unknowns in most.items()}
    return [name for name, share in shares.items() if LEAST_STEP * share > 1 or share == max(shares.values())]


def wanted_H(sizes: Sequence[float], bounds: Sequence[float], target: float) -> float:
    """The next level's H from those of the levels done and their bounds: where it should meet the target.

    Bounds are taken to fall at the rate of the last two; without that, or a target, H is halved.
    """
    H, rate = sizes[-1], observed_rate(sizes, bounds)
    if math.isnan(rate) or target <= 0:
        return H / 2
    aim = H * (MARGIN * target / bounds[-1]) ** (1 / rate)
    return min(max(aim, H / LARGEST_STEP), H / LEAST_STEP)


def observed_rate(sizes: Sequence[float], bounds: Sequence[float]) -> float:
    """That of the last two levels, as far as it is believed; NaN without two finite bounds."""
    if len(sizes) < 2 or not (math.isfinite(bounds[-2]) and math.isfinite(bounds[-1])):
        return math.nan
    observed = math.log(bounds[-2] / bounds[-1]) / math.log(sizes[-2] / sizes[-1])
    return min(max(observed, RATES[0]), RATES[1])
