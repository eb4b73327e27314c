"""How often the edges of each triangle are halved, for a bound that is wanted on few triangles.

A triangle with the share s of the squared bound becomes 4^g triangles if its edges are halved g times. They
have s / 16^g each, for the square of a bound falls like h^2, and their areas like h^2, too. So the squared
bound becomes sum s_i / 4^{g_i} on sum 4^{g_i} triangles. It is best if s_i / 16^{g_i} is alike everywhere. If
that one number is known, so are the g_i.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from unilateral.adaptive.level import Level
from unilateral.arrays import Array, Index
from unilateral.geometry.polygon import Polygon

MAX_HALVINGS = 4
"""A triangle's edges are halved at most this many times at once."""
BISECTIONS = 40
"""A bisection for theta has this many steps, which leave a part of 1e-12 of its first interval."""
LEAST_SHARE = 1e-60
"""Shares below this fraction of the largest one are not told apart."""
ADAPTED_GAIN = 1.5
"""Adapted meshes pay if uniform ones need more than this many times as many triangles.

Where solutions vary alike everywhere that ratio is seen to be 1.
"""
LEAST_ADAPTED = 200
"""Below so many unknowns all meshes cost alike, and none is adapted."""
LEAST_STEP = 1.25
LARGEST_STEP = 8.0
"""A level has at most LARGEST_STEP times the triangles of the one before, before neighbours follow.

If the limits allow neither the wanted step nor LEAST_STEP times the triangles, there is no other level.
"""
TARGET_PART = 0.93
"""The next level aims at this fraction of the wanted error."""
LAMBDA_RATE = 0.75
"""On adapted meshes lambda's bound falls like the unknowns to minus this, as H^{3/2}; 0.82 was observed."""
LEAST_MISS = 0.9
LARGEST_MISS = 1.5
"""The factor by which a bound missed its prediction is believed only as far as it lies between these two."""


class Division(NamedTuple):
    """How often each triangle's edges are halved: `halvings` (m,).

    That makes `times` as many triangles, before neighbours follow, and leaves the part `left` of the bound.
    """

    halvings: Index
    times: float
    left: float


def divide_uniformly(triangles: int, halvings: int = 1) -> Division:
    """All edges are halved so often; the bound falls like h."""
    return Division(np.full(triangles, halvings, dtype=np.int16), 4.0**halvings, 0.5**halvings)


def divide_by_shares(shares: Array, left: float = 0.0, times: float = math.inf) -> Division:
    """The fewest triangles that leave that part of the bound, but at most `times` as many as there are.

    The part is `left`. The `shares` (m,) are the triangles' parts of the square of the bound.
    """
    logarithms = np.log2(np.maximum(shares / shares.max(), LEAST_SHARE))
    squares = shares / shares.sum()

    def divide_at(theta: float) -> Division:
        halvings = np.clip(np.rint((logarithms - theta) / 4), 0, MAX_HALVINGS).astype(np.int16)
        parts = 4.0**halvings
        return Division(halvings, float(parts.mean()), math.sqrt(float((squares / parts).sum())))

    ends = float(logarithms.min()) - 4 * MAX_HALVINGS - 2, float(logarithms.max()) + 2
    enough = divide_at(bisect(lambda theta: divide_at(theta).left <= left, *ends)[0])
    if enough.times <= times:
        return enough
    return divide_at(bisect(lambda theta: divide_at(theta).times > times, *ends)[1])


def bisect(holds: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """The largest number between two ends for which `holds` is true, and one just above it."""
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if holds(middle):
            low = middle
        else:
            high = middle
    return low, high


def evenness(shares: Array) -> float:
    """The number of triangles of the best mesh over that of a uniformly refined one, for a bound far below.

    It is 1 where nothing is known: all shares are 0, or one is infinite.
    """
    if not 0 < shares.max() < math.inf:
        return 1.0
    s = shares / shares.max()
    return float(np.sqrt(s).sum() ** 2 / (len(s) * s.sum()))


def least_unknowns(polygon: Polygon, h: float) -> float:
    """The unknowns that a mesh of equal triangles of the size h has at least.

    Equilateral triangles make 2 / sqrt(3) times the area over h^2.
    """
    return 0.5 * polygon.area / h**2


def adapts(level: Level) -> bool:
    """Whether the next mesh is adapted: the goal leaves that open, and it pays or this one is already."""
    return level.goal.adaptable and (level.solved.mesh.adapted or refinement_pays(level))


def refinement_pays(level: Level) -> bool:
    """Whether uniform meshes need far more triangles than adapted ones, by the bound's parts.

    They do so at once where short sides leave a mesh with fewer unknowns than a uniform one has at least.
    """
    mesh = level.solved.mesh
    if level.unknowns < least_unknowns(mesh.polygon, mesh.h):
        return True
    return level.unknowns >= LEAST_ADAPTED and ADAPTED_GAIN * evenness(level.solved.shares) < 1


def wanted_division(last: Level) -> Division:
    """The wanted division, which is uniform where that takes at most ADAPTED_GAIN times the triangles.

    If several steps are needed, they are of one size.
    """
    part = wanted_part(last)
    shares = last.solved.shares
    if part == 0 or not last.goal.adaptable or not 0 < shares.max() < math.inf:
        return divide_uniformly(len(shares))
    needed = evenness(shares) / part**2
    if needed > LARGEST_STEP and not adapts(last):
        return divide_uniformly(len(shares))
    most = LARGEST_STEP
    if needed > LARGEST_STEP:
        steps = math.ceil(math.log(needed) / math.log(LARGEST_STEP))
        most = max(needed ** (1 / steps), 4.0)
    adapted_division = divide_by_shares(shares, part, most)
    halvings = max(math.ceil(-math.log2(part)), 1)
    if 4**halvings <= ADAPTED_GAIN * adapted_division.times:
        return divide_uniformly(len(shares), halvings)
    return adapted_division


def wanted_part(last: Level) -> float:
    """The part of the last bound that the next level is to leave; 0 where it is not known what is wanted.

    The next prediction is taken to miss by the same factor as the last one. The bound on lambda falls like
    the unknowns to the power -LAMBDA_RATE.
    """
    if not (last.target > 0 and math.isfinite(last.total)):
        return 0.0
    missed = last.total / last.predicted
    missed = min(max(missed, LEAST_MISS), LARGEST_MISS) if missed > 0 else 1.0
    part = TARGET_PART * last.target / (last.total * missed)
    return part if last.goal.norm == "h1" else part ** (0.5 / LAMBDA_RATE)
