"""The next level: uniform or adapted, the size at which its bound should be small enough, and the budget."""

from __future__ import annotations

import math
from collections.abc import Sequence

from unilateral.accuracy.cost import Prospect
from unilateral.accuracy.halvings import Division, divided, evenness, uniform
from unilateral.accuracy.level import WORTH, Level, standing, unknowable, without_contact
from unilateral.system.memory import available_mb

MARGIN = 0.93
"""The next level aims at this fraction of the wanted error."""
LEAST_STEP, LARGEST_STEP = 1.25, 8.0
"""A level has at most LARGEST_STEP times the triangles of the one before, before neighbours follow.

If the budget allows neither the wanted step nor LEAST_STEP times the triangles, no level is made.
"""
FOLLOW = 1.15
"""A mesh gets this many times the predicted triangles, because neighbours are refined, too."""
OF_LAMBDA = 0.75
"""On adapted meshes the bound on lambda falls like the unknowns to minus this power.

That is the rate of H^{3/2}; 0.82 was observed.
"""
RATES = (0.25, 2.0)
"""An observed rate is believed only as far as it lies between these two."""
SPARE = 0.8
"""The next level may take this fraction of the free memory, beside what the last one still holds."""


CAUTION = 0.7
"""If seconds or memory allow less than is wanted, this fraction of the unknowns that they allow is used.

What these unknowns are predicted to be was right within 1.5.
"""


def wanted(done: Sequence[Level]) -> bool:
    """Whether another level is wanted after these."""
    last = done[-1]
    over = last.certified or not last.solved.result.converged or unknowable(last) or without_contact(last)
    return not over and len(standing(done)) == len(done)


def division(prospect: Prospect) -> Division | None:
    """How to divide the triangles for the next level, None if it is not wanted or not within the budget.

    Where the budget does not allow what is wanted, the last level stays away from the limits.
    """
    if not wanted(prospect.done):
        return None
    last, most = prospect.done[-1], min(most_unknowns(prospect).values())
    best = _best(prospect)
    if FOLLOW * best.times * last.unknowns <= most:
        return best
    times = min(most_unknowns(prospect, CAUTION).values()) / (FOLLOW * last.unknowns)
    known = 0 < last.solved.shares.max() < math.inf
    if not (prospect.free and known) or times < LEAST_STEP:
        return None
    return divided(last.solved.shares, 0.0, times)


def _best(prospect: Prospect) -> Division:
    """The wanted division, which is uniform where that takes at most WORTH times the triangles.

    If several steps are needed, they are of one size.
    """
    last, part = prospect.done[-1], wanted_part(prospect.done)
    shares, m = last.solved.shares, len(last.solved.shares)
    if part == 0 or not prospect.free or not 0 < shares.max() < math.inf:
        return uniform(m)
    needed, most = evenness(shares) / part**2, LARGEST_STEP
    if needed > most and not prospect.adapted:
        return uniform(m)
    if needed > most:
        steps = math.ceil(math.log(needed) / math.log(most))
        most = max(needed ** (1 / steps), 4.0)
    found, times = divided(shares, part, most), max(math.ceil(-math.log2(part)), 1)
    return uniform(m, times) if 4**times <= WORTH * found.times else found


def wanted_part(done: Sequence[Level]) -> float:
    """The part of the last bound that the next level is to leave; 0 where it is not known what is wanted.

    The next prediction is taken to miss by the factor `missed` of the last one. The bound on lambda falls
    like the unknowns to the power -OF_LAMBDA.
    """
    last = done[-1]
    if not (last.target > 0 and math.isfinite(last.total)):
        return 0.0
    part = MARGIN * last.target / (last.total * last.missed)
    return part if last.goal.norm == "h1" else part ** (0.5 / OF_LAMBDA)


def sizes_and_bounds(done: Sequence[Level]) -> tuple[list[float], list[float]]:
    """H of each level, and the bound of each level."""
    return [level.partition.H for level in done], [level.total for level in done]


def most_unknowns(prospect: Prospect, part: float = 1.0) -> dict[str, float]:
    """The unknowns that each limit allows the next level to have.

    Where they are predicted, it is that `part` of them.
    """
    goal = prospect.done[-1].goal
    (of_memory, mb), (of_time, seconds) = goal.memory(SPARE * available_mb()), goal.seconds
    return {
        f"max_unknowns={goal.unknowns:.0f}": goal.unknowns,
        of_memory: part * prospect.within_mb(mb),
        of_time: part * prospect.within_seconds(seconds),
    }


def limits(prospect: Prospect) -> list[str]:
    """The limits that do not allow a level after the last one; the limit that allows least, if all do."""
    last, most = prospect.done[-1], most_unknowns(prospect)
    least = FOLLOW * (LEAST_STEP if prospect.free else 4) * last.unknowns
    return [name for name, unknowns in most.items() if unknowns < least or unknowns == min(most.values())]


def observed_rate(sizes: Sequence[float], bounds: Sequence[float]) -> float:
    """The rate between the last two levels, as far as it is believed; NaN without two finite bounds."""
    if len(sizes) < 2 or not (math.isfinite(bounds[-2]) and math.isfinite(bounds[-1])):
        return math.nan
    observed = math.log(bounds[-2] / bounds[-1]) / math.log(sizes[-2] / sizes[-1])
    return min(max(observed, RATES[0]), RATES[1])
