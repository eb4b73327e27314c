"""How often the edges of each triangle are to be halved, for a bound that is wanted on few triangles.

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

from unilateral.arrays import Array, Index

MOST_HALVINGS = 4
"""A triangle's edges are halved at most this many times at once."""
STEPS = 40
"""A bisection for theta has this many steps, which leave a part of 1e-12 of its first interval."""
TINY = 1e-60
"""Shares below this fraction of the largest one are not told apart."""


class Division(NamedTuple):
    """How often each triangle's edges are halved: `halvings` (m,).

    That makes `times` as many triangles, before neighbours follow, and leaves the part `left` of the bound.
    """

    halvings: Index
    times: float
    left: float


def uniform(triangles: int, halvings: int = 1) -> Division:
    """All edges are halved so often; the bound falls like h."""
    return Division(np.full(triangles, halvings, dtype=np.int16), 4.0**halvings, 0.5**halvings)


def evenness(shares: Array) -> float:
    """The number of triangles of the best mesh over that of a uniformly refined one, for a bound far below.

    It is 1 where nothing is known: all shares are 0, or one is infinite.
    """
    if not 0 < shares.max() < math.inf:
        return 1.0
    s = shares / shares.max()
    return float(np.sqrt(s).sum() ** 2 / (len(s) * s.sum()))


def divided(shares: Array, left: float = 0.0, times: float = math.inf) -> Division:
    """The fewest triangles that leave that part of the bound, but at most `times` as many as there are.

    The part is `left`. The `shares` (m,) are the triangles' parts of the square of the bound.
    """
    s = np.log2(np.maximum(shares / shares.max(), TINY))
    squares = shares / shares.sum()

    def at(theta: float) -> Division:
        g = np.clip(np.rint((s - theta) / 4), 0, MOST_HALVINGS).astype(np.int16)
        parts = 4.0**g
        return Division(g, float(parts.mean()), math.sqrt(float((squares / parts).sum())))

    found = at(_theta(lambda theta: at(theta).left <= left, s)[0])
    return found if found.times <= times else at(_theta(lambda theta: at(theta).times > times, s)[1])


def _theta(holds: Callable[[float], bool], s: Array) -> tuple[float, float]:
    """The largest theta for which `holds` is true, and one just above it, by bisection between two ends."""
    low, high = float(s.min()) - 4 * MOST_HALVINGS - 2, float(s.max()) + 2
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low, high
