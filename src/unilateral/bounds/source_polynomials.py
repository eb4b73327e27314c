"""f on whole triangles: those of a mesh, and those that they came from by refinement.

On a triangle f is near a polynomial p, |f - p| <= rad. This holds on all triangles of a mesh that lie in it.
The two variables of p are (1, -1) and (-1, 1) at the ends of the longest edge and (-1, -1) at the other
corner. In these variables the corners of the smaller triangles are multiples of FINEST, for each halving of
an edge halves the differences. In memory nodes are rounded midpoints: every halving rounds them by half an
EPS of their size. rad holds for coordinates that are rounded by up to ROUNDING of their size
(`source_pieces`), so p is used on triangles that are up to MOST_HALVINGS halvings finer.
"""

from __future__ import annotations

import itertools
from functools import cache
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, blocks
from unilateral.bounds.polynomial_means import ORDER, averages
from unilateral.bounds.source_pieces import on_triangles
from unilateral.fem.quadrature import symmetric
from unilateral.formulas.taylor import EPS, basis
from unilateral.problems.data import Data

MOST_HALVINGS = 6
"""p is used on triangles that are at most this many halvings finer than its own; 8 would use up ROUNDING."""
FINEST = 2.0**-MOST_HALVINGS
COMPUTED = 192
"""`values` may be off by this times EPS sum |c|, in f_h and in the root mean square of p - f_h together.

Points are off by 2 EPS in either variable, monomials have degree 4, and Horner's scheme takes 16 operations:
p is off by 16 EPS sum |c| in each point. The numbers that make f_h of p have absolute values of 2.5 in sum,
and as many terms as there are points, 16: f_h is off by 60. What is left of p is off by both, by its own two
operations and by a mean of 16 terms: by 85, which, with f_h, makes 145.

By `_matrices` a monomial is off by 10, and so is an entry of the first matrix by 2.5 (10 + 8) = 45; sums of
15 products add 7.5 times 2.5: f_h is off by 64. An entry of the second one is off by 10, 45 and its own five
operations on numbers up to 3.5, by 64; the products add 7.5 times 3.5, the mean 8: 98 and, with f_h, 162.
"""
FEW = 1 << 11
"""This many triangles are treated together: the numbers at their points fit into a processor's cache."""
LONG = 128
"""Runs of triangles that lie alike in those around them get matrices if they are this long on average."""


class Polynomials(NamedTuple):
    """p on triangles by its c (m, k), and rad (k,); `frame` (6, k) is the map from places to p's variables.

    Take a place less the last two rows. Its products with the first two rows and with the next two are, but
    for rounding, the two variables, in units of FINEST.
    """

    c: Array
    rad: Array
    frame: Array

    def and_more(self, others: Polynomials) -> Polynomials:
        return Polynomials(*(np.concatenate(both, axis=-1) for both in zip(self, others, strict=True)))

    def of(self, chosen: Index) -> Polynomials:
        """The polynomials that are chosen (k,)."""
        return Polynomials(*(each[..., chosen] for each in self))

    def averages(self) -> Array:
        """(2, k) the means of p and p^2."""
        return averages(self.c)


def none() -> Polynomials:
    return Polynomials(np.empty((len(basis(2, ORDER).degree), 0)), np.empty(0), np.empty((6, 0)))


def whole(corners: Array, size: float, data: Data) -> Polynomials:
    """f on triangles with those corners (k, 3, 2), of a mesh of that `rounded_size`."""
    found = [none()]
    for block in (corners[of] for of in blocks(len(corners))):
        c, rad, first = on_triangles(block, size, data)
        order = (first[:, None] + np.arange(3)) % 3
        frame = _frame(*np.take_along_axis(block, order[..., None], axis=1).transpose(1, 2, 0))
        found.append(Polynomials(c, rad + COMPUTED * EPS * np.abs(c).sum(axis=0), frame))
    return Polynomials(*(np.concatenate(each, axis=-1) for each in zip(*found, strict=True)))


def _frame(a: Array, u: Array, v: Array) -> Array:
    """(6, k) the `frame` of triangles with those corners (2, k), in units of FINEST."""
    e, f = 0.5 * (u - a), 0.5 * (v - a)
    scale = 1 / (FINEST * (e[0] * f[1] - e[1] * f[0]))
    return np.stack([f[1] * scale, -f[0] * scale, -e[1] * scale, e[0] * scale, *(0.5 * (u + v))])


def values(corners: Array, known: Polynomials, of: Int32) -> tuple[Array, Array]:
    """(3, k) the L2 projection f_h of p at the corners (2, 3, k), (k,) the mean of (p - f_h)^2.

    `of` (k,) says which p is known on each triangle. Where refinement was uniform, triangles in a row lie
    alike in those around them.
    """
    places, c = np.concatenate(inside(corners, known.frame[:, of])), known.c[:, of]
    change = np.flatnonzero((places[:, 1:] != places[:, :-1]).any(axis=0)) + 1
    if LONG * (len(change) + 1) > len(of):
        return _one_by_one(places, c)
    starts, (f_h, squares) = [0, *change.tolist()], (np.empty((3, len(of))), np.empty(len(of)))
    runs = itertools.starmap(slice, itertools.pairwise([*starts, len(of)]))
    for run, to_f_h, to_rest in zip(runs, *_matrices(places[:, starts]), strict=True):
        f_h[:, run], squares[run] = to_f_h @ c[:, run], np.sum((to_rest @ c[:, run]) ** 2, axis=0)
    return f_h, squares


def _one_by_one(places: Array, c: Array) -> tuple[Array, Array]:
    """`values` of the polynomials c (m, k) on triangles with those places (6, k) of their corners."""
    hats, weights = symmetric(2 * ORDER)
    p = _horner(c, hats @ places[:3], hats @ places[3:])
    f_h = _to_corners() @ p
    p -= hats @ f_h
    return f_h, weights @ p**2


def _matrices(places: Array) -> tuple[Array, Array]:
    """(r, 3, m), (r, q, m) matrices for places (6, r) that take c to f_h and to numbers for the rest.

    The squares of these numbers add up to the mean of (p - f_h)^2.
    """
    hats, weights = symmetric(2 * ORDER)
    x, y = (hats @ each for each in (places[:3], places[3:]))
    powers = [(x**i, y**i) for i in range(ORDER + 1)]
    monomials = np.stack([powers[i][0] * powers[j][1] for i, j in basis(2, ORDER).exponents]).T
    to_f_h = _to_corners() @ monomials
    return to_f_h, np.sqrt(weights)[:, None] * (monomials - hats @ to_f_h)


def inside(corners: Array, frame: Array) -> tuple[Array, Array]:
    """(3, k), (3, k) the exact variables of p at the corners (2, 3, k), for that `frame` (6, k)."""
    xx, xy, yx, yy, *middle = frame
    x, y = corners[0] - middle[0], corners[1] - middle[1]
    return FINEST * np.rint(xx * x + xy * y), FINEST * np.rint(yx * x + yy * y)


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
    """(3, q) the matrix from values at the points of the rule to f_h at the corners."""
    hats, weights = symmetric(2 * ORDER)
    return np.asarray((weights[:, None] * (12 * hats - 3)).T)
