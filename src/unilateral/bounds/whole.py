"""f on whole triangles: those of a mesh, and those that they came from by refinement.

On a triangle f is a polynomial p, |f - p| <= rad. So it is on all triangles of a mesh that lie in it. In the
variables of p, -1 and 1 at the ends of the longest edge and -1 both at the other corner, the corners of these
are multiples of FINEST, for each halving of an edge halves the differences. In memory nodes are midpoints
that are rounded: by half an EPS of their size for every halving. rad holds up to ROUNDING of it (`pieces`),
so p is used on triangles up to MOST_HALVINGS finer.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Int32
from unilateral.bounds.pieces import BLOCK, on_triangles
from unilateral.bounds.projection import ORDER, averages
from unilateral.fem.quadrature import symmetric
from unilateral.formulas.taylor import EPS, basis
from unilateral.problems.data import Data

MOST_HALVINGS = 6
"""Between a triangle and one of the mesh in it; 8 of them would be ROUNDING."""
FINEST = 2.0**-MOST_HALVINGS
COMPUTED = 192
"""Times EPS sum |c|: what `values` may be off by, in f_h and in the mean square of p - f_h together.

Points are off by 2 EPS in either variable, monomials have degree 4, and Horner's scheme takes 16 operations:
p is off by 16 EPS sum |c| in each point. The numbers that make f_h of p have absolute values of 2.5 in sum,
and as many terms as there are points, 16: f_h is off by 60. What is left of p is off by both, by its own two
operations and by a mean of 16 terms: by 85, which, with f_h, makes 145.
"""
FEW = 1 << 11
"""Triangles at a time: the numbers in their points fit into a processor's cache."""


class Polynomials(NamedTuple):
    """p's c (m, k) on triangles with the corners (k, 3, 2), that of sigma = (-1, -1) first; rad (k,)."""

    c: Array
    rad: Array
    corners: Array

    def and_more(self, others: Polynomials) -> Polynomials:
        return Polynomials(
            np.concatenate([self.c, others.c], axis=1),
            np.concatenate([self.rad, others.rad]),
            np.concatenate([self.corners, others.corners]),
        )

    def averages(self) -> Array:
        """(2, k) the means of p and p^2."""
        return averages(self.c)


def none() -> Polynomials:
    return Polynomials(np.empty((len(basis(2, ORDER).degree), 0)), np.empty(0), np.empty((0, 3, 2)))


def whole(corners: Array, size: float, data: Data) -> Polynomials:
    """f on triangles with those corners (k, 3, 2), of a mesh of that `rounded_size`."""
    found = none()
    c, rad, ordered = [found.c], [found.rad], [found.corners]
    for start in range(0, len(corners), BLOCK):
        block = corners[start : start + BLOCK]
        of_block, rad_of_block, first = on_triangles(block, size, data)
        order = (first[:, None] + np.arange(3)) % 3
        c.append(of_block)
        rad.append(rad_of_block + COMPUTED * EPS * np.abs(of_block).sum(axis=0))
        ordered.append(np.take_along_axis(block, order[..., None], axis=1))
    return Polynomials(np.concatenate(c, axis=1), np.concatenate(rad), np.concatenate(ordered))


def values(corners: Array, known: Polynomials, of: Int32) -> tuple[Array, Array]:
    """(3, k) the L2 projection f_h of p at the corners (k, 3, 2), (k,) the mean of (p - f_h)^2.

    `of` (k,) says which p is known on each triangle.
    """
    (hats, weights), to_corners = symmetric(2 * ORDER), _to_corners()
    x, y = (hats @ each for each in inside(corners, known.corners[of]))
    p = _horner(known.c[:, of], x, y)
    f_h = to_corners @ p
    p -= hats @ f_h
    return f_h, weights @ p**2


def inside(corners: Array, frame: Array) -> Array:
    """(2, 3, k) the variables of p, with the corners `frame` (k, 3, 2), at those corners (k, 3, 2): exact."""
    a, u, v = frame.transpose(1, 2, 0)
    e, f, middle = 0.5 * (u - a), 0.5 * (v - a), 0.5 * (u + v)
    x, y = corners.transpose(2, 1, 0) - middle[:, None]
    scale = 1 / (FINEST * (e[0] * f[1] - e[1] * f[0]))
    return FINEST * np.rint(np.stack([(x * f[1] - y * f[0]) * scale, (e[0] * y - e[1] * x) * scale]))


def _horner(c: Array, x: Array, y: Array) -> Array:
    """(q, k) the polynomials c (m, k) at x, y (q, k)."""
    number = _numbers()
    found = np.zeros_like(x)
    for j in range(ORDER, -1, -1):
        inner = np.zeros_like(x)
        for i in range(ORDER - j, -1, -1):
            inner *= x
            inner += c[number[i, j]]
        found *= y
        found += inner
    return found


@cache
def _numbers() -> dict[tuple[int, int], int]:
    return {(i, j): k for k, (i, j) in enumerate(basis(2, ORDER).exponents.tolist())}


@cache
def _to_corners() -> Array:
    """(3, q) from values at the points of the rule to f_h at the corners."""
    hats, weights = symmetric(2 * ORDER)
    return np.asarray((weights[:, None] * (12 * hats - 3)).T)
