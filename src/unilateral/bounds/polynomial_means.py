"""Polynomials p of degree ORDER on triangles: their means, and the means of their products with the hats.

The two variables sigma of p are (1, -1) and (-1, 1) at the ends of the edge opposite to a triangle's first
corner, and (-1, -1) at that corner.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from unilateral.arrays import Array
from unilateral.fem.quadrature import collapsed
from unilateral.formulas.taylor import basis

ORDER = 4


def averages(c: Array) -> Array:
    """(2, k) the means of p and of p^2, from the coefficients c (m, k) of p."""
    return np.stack([hat_means().sum(axis=0) @ c, np.sum((_triangular() @ c) ** 2, axis=0)])


@cache
def hat_means() -> Array:
    """(3, m) means of monomials times each hat."""
    (points, weights), values = collapsed(ORDER + 1), _monomials()
    return (points.T * weights) @ values.T


def _monomials() -> Array:
    """(m, q) the values of the monomials at the points of the rule."""
    points, _ = collapsed(ORDER + 1)
    return np.prod((2 * points.T[1:] - 1) ** basis(2, ORDER).exponents[..., None], axis=1)


@cache
def _triangular() -> Array:
    """(m, m) R with |R c|^2 = mean p^2; degrees increase, so the rows from 3 on give p - f_h."""
    _, weights = collapsed(ORDER + 1)
    return np.asarray(np.linalg.qr((_monomials() * np.sqrt(weights)).T, mode="r"))
