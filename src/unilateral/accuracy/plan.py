"""What a stated accuracy will take, from the first levels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from unilateral.accuracy.halvings import evenness
from unilateral.accuracy.level import Level, Prospect
from unilateral.accuracy.levels import LARGEST_STEP, MARGIN, OF_LAMBDA, most_unknowns, observed_rate, wanted

PROBE, KNOWN = 1.5, 400
"""Levels are enough for a plan from KNOWN unknowns on, if with the next one they take PROBE seconds."""
UNEVEN = 1.2
"""An adapted mesh has this many times the triangles of the best distribution."""
FAR = 10.0
"""An accuracy is hopeless if it needs more than this many times the unknowns that the limits allow.

A plan was right within 2 for u, and within 3 for lambda.
"""
VAST = 1e30
"""Bounds above this many times the wanted error are not told apart, so that their powers are finite."""


@dataclass(frozen=True)
class Plan:
    """Unknowns of the finest mesh, seconds from the beginning, MB; `missed` are the limits below that."""

    adapted: bool
    unknowns: int
    seconds: float
    peak_mb: float
    missed: tuple[str, ...]


def plan(prospect: Prospect) -> Plan | None:
    """The plan, or None if the size of the solution or of the error is not known at all."""
    last, sizes = prospect.done[-1], _sizes(prospect)
    if sizes is None:
        return None
    unknowns = max([last.unknowns, *sizes])
    seconds = prospect.elapsed + sum(map(prospect.seconds, sizes))
    missed = [name for name, most in most_unknowns(prospect).items() if sizes and most < unknowns]
    limit, most = last.goal.seconds
    if seconds > most:
        missed.append(limit)
    return Plan(
        prospect.adapted, round(unknowns), seconds, prospect.mb(unknowns), tuple(dict.fromkeys(missed))
    )


def enough(prospect: Prospect) -> bool:
    """Whether the levels done are enough for a plan."""
    sizes = _sizes(prospect)
    to_come = prospect.seconds(sizes[0]) if sizes else 0.0
    spent = sum(level.seconds for level in prospect.done)
    return prospect.done[-1].unknowns >= KNOWN and spent + to_come >= PROBE


def hopeless(prospect: Prospect) -> bool:
    """Whether the accuracy needs more than FAR times what the limits allow, where nobody set a limit.

    Bounds are taken to fall like H at least, because on coarse meshes they may seem to stand still.
    """
    if prospect.done[-1].goal.limited or not (wanted(prospect.done) and enough(prospect)):
        return False
    needed = _needed(prospect, least_rate=1.0)
    return math.isfinite(needed) and needed > FAR * min(most_unknowns(prospect).values())


def reach(prospect: Prospect) -> float | None:
    """The least accuracy of 1, 2 or 5 times a power of ten that the limits allow, None if none is known.

    None, too, where none of these is below what is reached.
    """
    goal, last = prospect.done[-1].goal, prospect.done[-1]
    share = last.total / last.size if last.size > 0 else 1.0
    reached = min(last.total, VAST) if goal.absolute else min(share, 1.0)
    if not reached > 0:
        return None
    exponents = range(math.floor(math.log10(goal.accuracy)), 1 + math.ceil(math.log10(reached)))
    for accuracy in (float(f"{digit}e{k}") for k in exponents for digit in (1, 2, 5)):
        if goal.accuracy < accuracy < reached:
            done = [replace(level, goal=replace(goal, accuracy=accuracy)) for level in prospect.done]
            found = plan(replace(prospect, done=done))
            if found and not found.missed:
                return accuracy
    return None


def _needed(prospect: Prospect, least_rate: float = 0.0) -> float:
    """The unknowns that the last mesh needs, infinite if unknown.

    On uniform meshes the bound is taken to fall on at the rate that was observed, or at the least one.
    """
    last = prospect.done[-1]
    target, s = _wanted(last), last.solved.shares
    if target <= 0 or not math.isfinite(last.total):
        return math.inf
    times = min(last.total / target, VAST)
    if prospect.adapted and last.goal.norm == "hm12":
        return last.unknowns * times ** (1 / OF_LAMBDA)
    if prospect.adapted:
        return last.unknowns * times**2 * UNEVEN * evenness(s)
    rate = observed_rate(prospect.done)
    return last.unknowns * (times / MARGIN) ** (2 / (1.0 if math.isnan(rate) else max(rate, least_rate)))


def _wanted(last: Level) -> float:
    """The error that will be wanted, for a solution whose norm is the discrete one's less that error."""
    goal, solved = last.goal, last.solved
    size = solved.u_norm if goal.norm == "h1" else solved.lambda_norm
    return goal.accuracy if goal.absolute else goal.accuracy * size / (1 + goal.accuracy)


def _sizes(prospect: Prospect) -> list[float] | None:
    """The unknowns of the levels that are still to come, None if unknown."""
    last, needed = prospect.done[-1], _needed(prospect)
    if last.certified or not math.isfinite(needed):
        return [] if last.certified else None
    step = LARGEST_STEP if prospect.adapted else 4.0
    count = max(math.ceil(math.log(needed / last.unknowns, step)), 1)
    return [*(last.unknowns * step**k for k in range(1, count)), max(needed, last.unknowns)]
