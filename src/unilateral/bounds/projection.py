"""Polynomials p of degree ORDER on triangles: on their parts, and projected to linear functions.

p's variables sigma are -1 and 1 at the ends of the edge opposite to a triangle's first corner, -1 both there.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.linalg import pascal

from unilateral.arrays import Array
from unilateral.fem.quadrature import collapsed
from unilateral.formulas.taylor import EPS, basis

ORDER = 4
CHILDREN = np.array([[1, -1, -1], [1, 1, -1], [1, -1, 1], [-1, -1, -1]]) / 2
"""sigma = a sigma' + (b, c) on the children, in their numbers at the parent's corners and the middle one."""


def halved(c: Array, halvings: int, first: int) -> Array:
    """(k 4^halvings, m) p's coefficients on the descendants of triangles, in their order in a mesh.

    The rows of c (k, m) are p's on the triangles, whose corner `first` is the one of sigma = (-1, -1).
    """
    for _ in range(halvings):
        c = (c @ _halving(first)).reshape(-1, c.shape[1])
    return c


def projected(c: Array, first: int) -> tuple[Array, Array]:
    """(k, 3) the L2 projection f_h of p at the corners, and the means (k,) of (p - f_h)^2; c as `halved`."""
    found = c @ _projection(first)
    return found[:, :3], np.einsum("ki,ki->k", found[:, 3:], found[:, 3:])


def rounding(c: Array, halvings: int) -> Array:
    """(k,) what rounding may change f_h and p - f_h by there, in the mean square; c (m, k) on the triangles.

    In units of EPS sum |c|: 15 terms, each rounded by EPS / 2. No halving makes that sum larger: its numbers
    are exact, and those that a coefficient is multiplied by have absolute values of 1 in sum. Those of
    `projected` are at most 1 for f_h, and 1/4 in norm for the rest; they are off by 8 units at most.
    """
    return (24 + 8 * halvings) * EPS * np.abs(c).sum(axis=0)


def averages(c: Array) -> Array:
    """(2, k) the means of p and of p^2, of c (m, k)."""
    return np.stack([hat_means().sum(axis=0) @ c, np.sum((_triangular() @ c) ** 2, axis=0)])


@cache
def hat_means() -> Array:
    """(3, m) means of monomials times each hat."""
    (points, weights), values = collapsed(ORDER + 1), _monomials()
    return (points.T * weights) @ values.T


def _monomials() -> Array:
    """(m, q) their values at the points of the rule."""
    points, _ = collapsed(ORDER + 1)
    return np.prod((2 * points.T[1:] - 1) ** basis(2, ORDER).exponents[..., None], axis=1)


@cache
def _triangular() -> Array:
    """(m, m) R with |R c|^2 = mean p^2; degrees increase, so the rows from 3 on give p - f_h."""
    _, weights = collapsed(ORDER + 1)
    return np.asarray(np.linalg.qr((_monomials() * np.sqrt(weights)).T, mode="r"))


@cache
def _projection(first: int) -> Array:
    """(m, m) from c to f_h at the corners, and to p - f_h in an orthonormal basis."""
    f_h = 12 * hat_means() - 3 * hat_means().sum(axis=0)
    return np.concatenate([np.roll(f_h, first, axis=0), _triangular()[3:]]).T


@cache
def _halving(first: int) -> Array:
    """(m, 4 m) from c to those on the children, in their order in a mesh: all numbers are exact."""
    a = basis(2, ORDER).exponents
    b, times = a[:, None], pascal(ORDER + 1, "lower")[a, a[:, None]]
    each = [
        np.prod(times * half**b * np.array(shift) ** np.maximum(a - b, 0), axis=2)
        for half, *shift in CHILDREN.tolist()
    ]
    return np.concatenate([*np.roll(each[:3], first, axis=0), each[3]]).T
