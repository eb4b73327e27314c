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
"""A bisection for theta has this many steps, which leave 1e-12 of its first interval."""
MIN_SHARE_RATIO = 1e-60
"""Shares below this fraction of the largest one are not told apart."""
MIN_ADAPTED_GAIN = 1.5
"""Adapted meshes pay if uniform ones need more than this many times as many triangles.

Where solutions vary alike everywhere that ratio is seen to be 1.
"""
MIN_ADAPTED_UNKNOWNS = 200
"""Below so many unknowns all meshes cost alike, and none is adapted."""
MIN_TRIANGLE_RATIO = 1.25
MAX_TRIANGLE_RATIO = 8.0
"""A level has at most MAX_TRIANGLE_RATIO times the triangles of the one before, before neighbours follow.

If the limits allow neither the wanted division nor MIN_TRIANGLE_RATIO, there is no other level.
"""
TARGET_SHARE = 0.93
"""The next level aims at this fraction of the wanted error."""
LAMBDA_RATE = 0.75
"""On adapted meshes lambda's bound falls like the unknowns to minus this, as H^{3/2}; 0.82 was observed.

So do the intervals of forces, whose half-widths are this bound times a norm; beside clamped sides less.
"""
MIN_MISS_FACTOR = 0.9
MAX_MISS_FACTOR = 1.5
"""The factor by which a bound missed its prediction is believed only as far as it lies between these two."""


class Division(NamedTuple):
    """How often each triangle's edges are halved: `halvings` (m,).

    That makes `triangle_ratio` as many triangles, before neighbours follow, and leaves the part `bound_ratio`
    of the bound.
    """

    halvings: Index
    triangle_ratio: float
    bound_ratio: float


def divide_uniformly(triangles: int, halvings: int = 1) -> Division:
    """All edges are halved so often; the bound falls like h."""
    return Division(np.full(triangles, halvings, dtype=np.int16), 4.0**halvings, 0.5**halvings)


def divide_by_shares(
    shares: Array, bound_ratio: float = 0.0, max_triangle_ratio: float = math.inf
) -> Division:
    """The division into the fewest triangles that leaves `bound_ratio` of the bound, within a limit.

    The `shares` (m,) are the triangles' parts of the square of the bound. If more than `max_triangle_ratio`
    times the triangles are needed, it is the best division within that.
    """
    logarithms = np.log2(np.maximum(shares / shares.max(), MIN_SHARE_RATIO))
    relative_shares = shares / shares.sum()

    # s_i / 16^{g_i} = 2^theta up to the rounding of g_i; the larger theta, the fewer triangles
    def divide_at(theta: float) -> Division:
        """The division with g_i = (log2 s_i - theta) / 4; sum s_i / 4^{g_i} of the squared bound is left."""
        halvings = np.clip(np.rint((logarithms - theta) / 4), 0, MAX_HALVINGS).astype(np.int16)
        child_counts = 4.0**halvings
        return Division(
            halvings, float(child_counts.mean()), math.sqrt(float((relative_shares / child_counts).sum()))
        )

    # at `low` all edges are halved MAX_HALVINGS times, at `high` none
    low = float(logarithms.min()) - 4 * MAX_HALVINGS - 2
    high = float(logarithms.max()) + 2
    theta, _ = bisect(lambda theta: divide_at(theta).bound_ratio <= bound_ratio, low, high)
    division = divide_at(theta)
    if division.triangle_ratio <= max_triangle_ratio:
        return division
    _, theta = bisect(lambda theta: divide_at(theta).triangle_ratio > max_triangle_ratio, low, high)
    return divide_at(theta)


def bisect(condition: Callable[[float], bool], low: float, high: float) -> tuple[float, float]:
    """The largest number between two ends for which `condition` is true, and one just above it.

    The condition has to be true up to some number. If it is false everywhere, both numbers are near `low`.
    """
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        if condition(middle):
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
    # triangles into n_i each leave sum s_i / n_i: (sum s_i^{1/2})^2 / n at best, for n_i ~ s_i^{1/2}, and
    # m sum s_i / n if all n_i are equal
    s = shares / shares.max()
    return float(np.sqrt(s).sum() ** 2 / (len(s) * s.sum()))


def min_unknowns(polygon: Polygon, h: float) -> float:
    """The unknowns that a mesh of equal triangles of the size h has at least.

    Equilateral triangles make 2 / sqrt(3) times the area over h^2.
    """
    return 0.5 * polygon.area / h**2


def should_adapt(level: Level) -> bool:
    """Whether the next mesh is adapted: the goal leaves that open, and it pays or this one is already."""
    return level.goal.can_adapt and (level.solved.mesh.is_adapted or refinement_pays(level))


def refinement_pays(level: Level) -> bool:
    """Whether uniform meshes need far more triangles than adapted ones, by the bound's parts.

    They do so at once where short sides leave a mesh with fewer unknowns than a uniform one has at least.
    """
    mesh = level.solved.mesh
    if level.unknowns < min_unknowns(mesh.polygon, mesh.h):
        return True
    return (
        level.unknowns >= MIN_ADAPTED_UNKNOWNS and MIN_ADAPTED_GAIN * evenness(level.solved.bound_shares) < 1
    )


def choose_target_division(level: Level) -> Division:
    """The wanted division, which is uniform where that takes at most MIN_ADAPTED_GAIN times the triangles.

    If several steps are needed, they are of one size.
    """
    bound_ratio = target_bound_ratio(level)
    shares = level.solved.bound_shares
    # One uniform refinement, if it is not known what is wanted or where the bound comes from
    if bound_ratio == 0 or not level.goal.can_adapt or not 0 < shares.max() < math.inf:
        return divide_uniformly(len(shares))
    # uniform meshes need 1 / bound_ratio^2 times the triangles, the best one `evenness` times that
    needed = evenness(shares) / bound_ratio**2
    max_triangle_ratio = MAX_TRIANGLE_RATIO
    if needed > MAX_TRIANGLE_RATIO:
        # Several steps: uniform ones while adapted meshes do not pay, and none smaller than those
        if not should_adapt(level):
            return divide_uniformly(len(shares))
        steps = math.ceil(math.log(needed) / math.log(MAX_TRIANGLE_RATIO))
        max_triangle_ratio = max(needed ** (1 / steps), 4.0)
    adapted_division = divide_by_shares(shares, bound_ratio, max_triangle_ratio)
    halvings = max(math.ceil(-math.log2(bound_ratio)), 1)
    if 4**halvings <= MIN_ADAPTED_GAIN * adapted_division.triangle_ratio:
        return divide_uniformly(len(shares), halvings)
    return adapted_division


def target_bound_ratio(level: Level) -> float:
    """The part of the last bound that the next level is to leave; 0 where it is not known what is wanted."""
    if not (level.target > 0 and math.isfinite(level.total)):
        return 0.0
    # the next prediction is taken to miss by the same factor as the last one
    miss_factor = level.total / level.predicted_total
    miss_factor = min(max(miss_factor, MIN_MISS_FACTOR), MAX_MISS_FACTOR) if miss_factor > 0 else 1.0
    bound_ratio = TARGET_SHARE * level.target / (level.total * miss_factor)
    # Divisions are for a bound like n^{-1/2}. Lambda's, like n^{-LAMBDA_RATE}, has this power of it
    return bound_ratio if level.goal.norm == "h1" else bound_ratio ** (0.5 / LAMBDA_RATE)
