"""f on a mesh, enclosed: its linear part on every triangle, and a bound of what the rest can do.

Triangles are cut into pieces. On a piece f is a polynomial p, |f - p| <= rad (`taylor`); at a jump that holds
but for a part of it whose area is bounded (`jumps`). Pieces are quartered until sum |piece| rad^2 is
small, so that no peak of f can hide between points. With f_h the L2 projection of p onto linear functions on
each triangle T, and E_T a bound of ||f - p||_T,

    (f - f_h, w)_T <= d_T/j ||p - f_h||_T |w|_{1,T} + E_T ||w||_T,

d_T the diameter of T and j = 3.83.. the first zero of the Bessel function J_1: the optimal constant in
Poincare's inequality for triangles of that diameter (Laugesen and Siudeja, J. Differential Equations 249,
2010).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.pieces import ORDER, Pieces, areas, known_at_points, polynomials
from unilateral.fem.quadrature import symmetric
from unilateral.fem.splitting import quarter
from unilateral.formulas.taylor import basis
from unilateral.geometry.mesh import Mesh
from unilateral.problems.data import Data

J = 3.8317
"""The first zero of J_1, 3.83170597.., rounded down."""
ENOUGH = 0.003
"""Of h ||p - mean p||, like discretisation errors: what the rest of f may be; h of triangles all alike."""
IN_VAIN = 16.0
"""Times what rounding leaves: a piece with that E^2 is not quartered."""
RESOLVED = 4.0
"""Times what the sum of E^2 is wanted to be: up to which it counts as that."""
FLOOR = 1e-13
"""Of ||p||: its rounding, which no smaller piece takes away."""
MOST_PIECES = 200_000
"""To be looked at on a mesh, or four times its triangles."""


@dataclass(frozen=True, eq=False)
class Source:
    """f_h (m, 3) at the triangles' vertices, and what is left of f on each triangle.

    f - f_h is a function with mean 0 and a norm of at most `oscillation` (m,), which is ||p - f_h||_T but for
    jumps, and one with a norm of at most `rest` (m,), which is E_T, `resolved` if it is as small as wanted.

    `moments` (m, 3) are those of p with the triangle's hats.
    """

    mesh: Mesh
    f_h: Array
    moments: Array
    oscillation: Array
    rest: Array
    resolved: bool = True

    @property
    def distance(self) -> float:
        """A bound of the norm of f - f_h in the dual of H^1."""
        return self.distance_with(0.0)

    def distance_with(self, more: Array | float) -> float:
        """The same for f - f_h and functions with mean 0 and those norms (m,) on the triangles together."""
        return math.sqrt(self.squares_with(more).sum())

    def squares_with(self, more: Array | float) -> Array:
        """(m,) the triangles' parts of its square."""
        free = self.oscillation + more
        apart = (poincare(self.mesh) * free) ** 2 + self.rest**2
        return np.asarray(np.minimum(apart, (free + self.rest) ** 2))

    @property
    def unknown(self) -> float:
        """What of that is f - p, whose means are not known."""
        return float(np.linalg.norm(self.rest))


def poincare(mesh: Mesh) -> Array:
    """(m,) the constants C of ||w - mean w||_T <= C |w|_{1,T}."""
    return mesh.longest_edges / J


def enclosed(mesh: Mesh, data: Data) -> Source:
    """f on the mesh; `rest` is infinite where f has no bound, and large where the pieces did not suffice."""
    n = len(mesh.triangles)
    corners, parent, left = np.broadcast_to(np.eye(3), (n, 3, 3)), np.arange(n), max(MOST_PIECES, 4 * n)
    done: list[Pieces] = []
    while True:
        pieces, owner = polynomials(mesh, corners, parent, data)
        left -= len(owner)
        rest = _rest(mesh, pieces)
        squares = np.bincount(owner, rest, len(parent)).astype(float)
        unknown, enough, count = _sums(mesh, [*done, pieces])
        wide = squares > (0.5 * enough / count if unknown > enough else np.inf)
        wide[wide] = squares[wide] > IN_VAIN * known_at_points(mesh, corners[wide], parent[wide], data)
        if 4 * np.count_nonzero(wide) > left:
            wide &= np.argsort(np.argsort(-squares)) < left // 4
        done.append(pieces.of(~wide[owner]))
        if not wide.any():
            return _projected(mesh, done, resolved=unknown <= RESOLVED * enough)
        corners, parent = quarter(corners[wide]), np.repeat(parent[wide], 4)


def _sums(mesh: Mesh, everything: Sequence[Pieces]) -> tuple[float, float, int]:
    """The sum of E^2 on all pieces, what it is wanted to be at most, and their number.

    Wanted is a share of ||f - mean f||, of which p shows no more than what exceeds E.
    """
    unknown = norm_squared = integral = 0.0
    for pieces in everything:
        area = areas(mesh, pieces)
        unknown += float(_rest(mesh, pieces).sum())
        norm_squared += float(area @ _quadratic(pieces.c))
        integral += float(area @ (_moments()[:3].sum(axis=0) @ pieces.c))
    spread = math.sqrt(max(norm_squared - integral**2 / mesh.areas.sum(), 0.0)) - math.sqrt(unknown)
    size = math.sqrt(2 * mesh.areas.sum() / len(mesh.areas))
    enough = max(ENOUGH * size * spread, FLOOR * (math.sqrt(norm_squared) - math.sqrt(unknown)), 0.0)
    return unknown, enough**2, sum(len(pieces.squares) for pieces in everything)


def _rest(mesh: Mesh, pieces: Pieces) -> Array:
    """(k,) the pieces' E^2, a lack in the integral spread over their triangles."""
    return np.asarray(pieces.squares + pieces.integral**2 / mesh.areas[pieces.parent])


@cache
def _moments() -> Array:
    """(3 + m, m) means on a piece of monomials times its three hats, then times each other."""
    of = basis(2, ORDER)
    points, weights = symmetric(2 * ORDER)
    values = np.prod((2 * points.T[1:] - 1) ** of.exponents[..., None], axis=1)
    return (np.concatenate([points.T, values]) * weights) @ values.T


def _quadratic(c: Array) -> Array:
    """(k,) means of p^2."""
    return np.maximum(np.einsum("ak,ak->k", c, _moments()[3:] @ c), 0.0)


def _projected(mesh: Mesh, done: list[Pieces], resolved: bool) -> Source:
    n = len(mesh.triangles)
    moments, squares, rest, jumping, integral = np.zeros((n, 3)), *np.zeros((4, n))
    for pieces in done:
        own = areas(mesh, pieces)[:, None] * (_moments()[:3] @ pieces.c).T
        np.add.at(moments, pieces.parent, np.einsum("ki,kib->kb", own, pieces.corners))
        for sums, values in (
            (rest, pieces.squares),
            (jumping, pieces.jumping**2),
            (integral, pieces.integral),
        ):
            sums += np.bincount(pieces.parent, values, n)
    f_h = (12 * moments - 3 * moments.sum(axis=1, keepdims=True)) / mesh.areas[:, None]
    for pieces in done:
        a, b, c = np.einsum("kib,kb->ik", pieces.corners, f_h[pieces.parent])
        left = pieces.c.copy()
        left[:3] -= 0.5 * np.stack([b + c, c - a, b - a])  # of degree 1: (0, 1), (1, 0)
        squares += np.bincount(pieces.parent, pieces.outer * _quadratic(left), n)
    oscillation = np.sqrt(squares) + np.sqrt(jumping)
    rest = np.sqrt(rest) + integral / np.sqrt(mesh.areas)
    return Source(mesh, f_h, moments, oscillation, rest, resolved)
