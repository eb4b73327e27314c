"""What the next level and the rest take, by the rate that was observed, and what the limits allow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from unilateral.adaptive.goal import DEFAULT_MAX_SECONDS, Goal
from unilateral.adaptive.level import Level, judge_for_goal
from unilateral.adaptive.marking import LAMBDA_RATE, MAX_TRIANGLE_RATIO, TARGET_SHARE, evenness, should_adapt
from unilateral.discrete.choice import SHARP_BOUND_BYTES, SPARSE_BYTES, wants_multigrid
from unilateral.errors import BudgetError
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.system.memory import BYTES_PER_MB, available_mb, peak_mb

NEIGHBOUR_RATIO = 1.15
"""A mesh gets this many times the predicted triangles, because neighbours are refined, too."""
FREE_MEMORY_SHARE = 0.8
"""The next level may take this fraction of the free memory, beside what the last one still has."""
MULTIGRID_LEVEL_BYTES = 1100
"""Bytes per unknown of a level by multigrid, with its cheap bound, as measured with 1e6 unknowns."""
OVERHEAD_UNKNOWNS = 2000
"""A level takes as long as one of this many more unknowns would, if time were proportional to these."""
MIN_PLAN_UNKNOWNS = 2000
"""Levels show what the rest takes from so many unknowns on."""
RATE_LIMITS = (0.25, 2.0)
"""An observed rate is believed only as far as it lies between these two."""
ADAPTED_TRIANGLE_RATIO = 1.2
"""An adapted mesh has this many times the triangles of the best distribution."""
HOPELESS_UNKNOWNS_RATIO = 10.0
"""An accuracy is out of reach if it needs more than this many times the unknowns that the limits allow.

A plan was right within 2 for u, and within 3 for lambda.
"""
MAX_ERROR_QUOTIENT = 1e30
"""Bounds above this many times the wanted error are not told apart, so that their powers are finite."""


@dataclass(frozen=True)
class Plan:
    """What an accuracy takes: unknowns of the finest mesh, seconds from the beginning, MB.

    `missed` are the limits below that.
    """

    adapted: bool
    unknowns: int
    seconds: float
    peak_mb: float
    missed: tuple[str, ...]


def find_limits(goal: Goal, base_mb: float) -> tuple[tuple[str, float], ...]:
    """The limits of unknowns, MB and seconds, each with its name in messages.

    Beside the `base_mb` that a level takes whatever its size, a part of the free memory may be used.
    """
    max_unknowns = math.inf if goal.max_unknowns is None else goal.max_unknowns
    max_mb = base_mb + FREE_MEMORY_SHARE * available_mb()
    memory = f"{max_mb:.0f} MB of this machine's memory"
    if goal.max_memory is not None and goal.max_memory <= max_mb:
        max_mb = goal.max_memory
        memory = f"max_memory={max_mb:g}"
    max_seconds = DEFAULT_MAX_SECONDS if goal.max_seconds is None else goal.max_seconds
    by_default = " by default" if goal.max_seconds is None else ""
    return (
        (f"max_unknowns={max_unknowns:.0f}", max_unknowns),
        (memory, max_mb),
        (f"max_seconds={max_seconds:g}{by_default}", max_seconds),
    )


def check_limits(polygon: Polygon, goal: Goal, elapsed: float) -> None:
    """Raises BudgetError where the memory or the seconds are already used up before the first level."""
    mb = peak_mb()
    for (name, limit), used in zip(find_limits(goal, mb), (0.0, mb, elapsed), strict=True):
        if used >= limit:
            raise BudgetError(f"{name} is not enough to solve on the coarsest mesh of '{polygon.name}'")


def allowed_unknowns(levels: Sequence[Level], share: float = 1.0) -> dict[str, float]:
    """The unknowns that each limit allows the next level to have, by the name of the limit.

    Of those that memory and seconds are predicted to allow it is that `share`.
    """
    last = levels[-1]
    base_mb = predict_mb(levels, 0.0)
    (unknowns_name, max_unknowns), (memory_name, max_mb), (time_name, max_seconds) = find_limits(
        last.goal, base_mb
    )
    # memory: what the last level left of it; time: start + seconds_per_unknown n <= what is left of it
    in_memory = (max_mb - base_mb) * BYTES_PER_MB / bytes_per_unknown(last.goal)
    remaining = max_seconds - last.elapsed
    start, seconds_per_unknown = observe_seconds(levels)
    in_time = (remaining - start) / seconds_per_unknown
    if len(levels) == 1:  # in which code is loaded, so that its time says nothing of the next one
        in_time = math.inf if remaining > 0 else 0.0
    return {
        unknowns_name: max_unknowns,
        memory_name: share * max(in_memory, 0.0),
        time_name: share * max(in_time, 0.0),
    }


def observe_seconds(levels: Sequence[Level]) -> tuple[float, float]:
    """The seconds that a level takes whatever its size, and those per unknown.

    The first level is left out if there are others, for code is loaded in it.
    """
    last = levels[-1]
    # Solving and bounding: proportional to the unknowns and those of the overhead
    later = levels[1:] or levels
    solving = sum(level.seconds - level.enclosing_seconds for level in later)
    solving /= sum(level.unknowns + OVERHEAD_UNKNOWNS for level in later)
    # Enclosing f: it goes on to grow as it did with the last level, at least not to fall
    enclosing = 0.0
    new_unknowns = last.unknowns - levels[-2].unknowns if len(levels) > 1 else 0
    if new_unknowns > 0:  # a division that halves no triangle makes none
        enclosing = max((last.enclosing_seconds - levels[-2].enclosing_seconds) / new_unknowns, 0.0)
    start = last.enclosing_seconds - enclosing * last.unknowns + solving * OVERHEAD_UNKNOWNS
    return start, solving + enclosing


def predict_seconds(levels: Sequence[Level], unknowns: float) -> float:
    """The seconds of a next level with so many unknowns."""
    start, per_unknown = observe_seconds(levels)
    return start + per_unknown * unknowns


def bytes_per_unknown(goal: Goal) -> float:
    """The bytes that an unknown takes in a level."""
    in_solve = MULTIGRID_LEVEL_BYTES if wants_multigrid(goal.stop, math.inf) else SPARSE_BYTES
    return in_solve + SHARP_BOUND_BYTES * goal.sharp


def predict_mb(levels: Sequence[Level], unknowns: float) -> float:
    """The MB of the process in a next level with so many unknowns."""
    mb_per_unknown = bytes_per_unknown(levels[-1].goal) / BYTES_PER_MB
    return max(level.peak_mb + mb_per_unknown * (unknowns - level.unknowns) for level in levels)


def make_plan(levels: Sequence[Level]) -> Plan | None:
    """The plan, or None if the size of the solution or of the error is not known at all."""
    last = levels[-1]
    sizes = predict_sizes(levels)
    if sizes is None:
        return None
    # all levels take time, the largest one the memory
    unknowns = max([last.unknowns, *sizes])
    seconds = last.elapsed + sum(predict_seconds(levels, size) for size in sizes)
    mb = predict_mb(levels, unknowns)
    limits = find_limits(last.goal, predict_mb(levels, 0.0))
    missed = [
        name for (name, limit), used in zip(limits, (unknowns, mb, seconds), strict=True) if used > limit
    ]
    return Plan(should_adapt(last), round(unknowns), seconds=seconds, peak_mb=mb, missed=tuple(missed))


def show_costs(levels: Sequence[Level]) -> bool:
    """Whether the levels are enough for a plan: large, and more than the first, in which code is loaded."""
    return len(levels) > 1 and levels[-1].unknowns >= MIN_PLAN_UNKNOWNS


def is_hopeless(levels: Sequence[Level]) -> bool:
    """Whether the accuracy needs far more unknowns than the limits allow, where nobody set a limit.

    Bounds are taken to fall like H at least, because on coarse meshes they may seem to stand still.
    """
    if levels[-1].goal.has_limits or levels[-1].certified or not show_costs(levels):
        return False
    needed = predict_unknowns(levels, min_rate=1.0)
    return math.isfinite(needed) and needed > HOPELESS_UNKNOWNS_RATIO * min(allowed_unknowns(levels).values())


def reachable_accuracy(levels: Sequence[Level]) -> float | None:
    """The least accuracy of 1, 2 or 5 times a power of ten that the limits allow, None if none is known.

    It is between the accuracy of the goal and the one that is reached; None, too, where none of these is.
    """
    last = levels[-1]
    goal = last.goal
    if goal.absolute:
        reached = min(last.total, MAX_ERROR_QUOTIENT)  # its logarithm is finite
    else:
        reached = min(last.total / last.size, 1.0) if last.size > 0 else 1.0
    if not reached > 0:
        return None
    # The plans for these accuracies, from the smallest one on
    exponents = range(math.floor(math.log10(goal.accuracy)), 1 + math.ceil(math.log10(reached)))
    for accuracy in (float(f"{digit}e{k}") for k in exponents for digit in (1, 2, 5)):
        if goal.accuracy < accuracy < reached:
            planned = make_plan([*levels[:-1], judge_for_goal(last, replace(goal, accuracy=accuracy))])
            if planned and not planned.missed:
                return accuracy
    return None


def predict_unknowns(levels: Sequence[Level], min_rate: float = 0.0) -> float:
    """The unknowns that the last mesh needs, infinite if unknown.

    On uniform meshes the bound is taken to fall on at the rate that was observed, but `min_rate` at least.
    """
    last = levels[-1]
    goal = last.goal
    target = goal.accuracy
    if not goal.absolute:
        # of the solution's norm, of which the discrete one less the target is known: t = accuracy (norm - t)
        target *= last.discrete_size / (1 + goal.accuracy)
    if target <= 0 or not math.isfinite(last.total):
        return math.inf
    # the bound has to fall by the quotient: like n^{-LAMBDA_RATE}, like n^{-1/2}, or like H^rate, n ~ H^{-2}
    quotient = min(last.total / target, MAX_ERROR_QUOTIENT)
    if should_adapt(last) and goal.norm != "h1":
        return last.unknowns * quotient ** (1 / LAMBDA_RATE)
    if should_adapt(last):
        return last.unknowns * quotient**2 * ADAPTED_TRIANGLE_RATIO * evenness(last.solved.bound_shares)
    rate = observed_rate(levels)
    rate = 1.0 if math.isnan(rate) else max(rate, min_rate)
    return last.unknowns * (quotient / TARGET_SHARE) ** (2 / rate)


def predict_sizes(levels: Sequence[Level]) -> list[float] | None:
    """The unknowns of the levels that are still to come, None if unknown."""
    last = levels[-1]
    if last.certified:
        return []
    needed = predict_unknowns(levels)
    if not math.isfinite(needed):
        return None
    if not last.goal.can_adapt:
        return predict_uniform_sizes(last.solved.mesh, needed)
    # The last level has what is needed, for `divide_by_shares` stops there. Those before it are quartered, or
    # grow by the most that an adapted mesh may
    step = MAX_TRIANGLE_RATIO if should_adapt(last) else 4.0
    count = max(math.ceil(math.log(needed / last.unknowns, step)), 1)
    return [*(last.unknowns * step**k for k in range(1, count)), max(needed, last.unknowns)]


def predict_uniform_sizes(mesh: Mesh, needed: float) -> list[float]:
    """The unknowns of the uniform refinements of a mesh, up to the first that has as many as are `needed`."""
    sizes: list[float] = []
    while not sizes or sizes[-1] < needed:
        # k refinements make 4^k t triangles and 2^k b boundary nodes: by Euler 1 + (4^k t + 2^k b) / 2 nodes
        k = len(sizes) + 1
        sizes.append(1 + (4.0**k * len(mesh.triangles) + 2.0**k * len(mesh.boundary)) / 2)
    return sizes


def observed_rate(levels: Sequence[Level]) -> float:
    """The rate between the last two levels, as far as it is believed; NaN without two finite bounds."""
    if len(levels) < 2 or not all(math.isfinite(level.total) for level in levels[-2:]):
        return math.nan
    coarse, fine = levels[-2:]
    rate = math.log(coarse.total / fine.total) / math.log(coarse.partition.H / fine.partition.H)
    return min(max(rate, RATE_LIMITS[0]), RATE_LIMITS[1])
