"""f on a mesh, enclosed: its linear part on every triangle, and a bound of what the rest can do.

On a piece f is a polynomial p, |f - p| <= rad (`taylor`). On a mesh made by refinement the first pieces are
the triangles of a coarser level; where rad is not small they give way to the next level (`whole`). Triangles
of the mesh itself are cut at a jump, where the bound holds but for a part whose area is bounded (`jumps`).
Pieces are quartered until sum |piece| rad^2 is small, so that no peak of f can hide between points. With f_h
the L2 projection of p onto linear functions on each triangle T, and E_T a bound of ||f - p||_T,

    (f - f_h, w)_T <= d_T/j ||p - f_h||_T |w|_{1,T} + E_T ||w||_T,

d_T the diameter of T and j = 3.83.. the first zero of the Bessel function J_1: the optimal constant in
Poincare's inequality for triangles of that diameter (Laugesen and Siudeja, J. Differential Equations 249,
2010).
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.pieces import Pieces, areas, known_at_points, polynomials
from unilateral.bounds.projection import averages, hat_means
from unilateral.bounds.whole import MOST_HALVINGS, Values, whole
from unilateral.fem.splitting import quarter
from unilateral.geometry.mesh import Mesh
from unilateral.problems.data import Data

J = 3.8317
"""The first zero of J_1, 3.83170597.., rounded down."""
ENOUGH = 0.003
"""Of h ||p - mean p||, like discretisation errors: what the rest of f may be; h of triangles all alike."""
ABOVE = 1e-3
"""Of that: on coarser levels, where it costs next to nothing."""
IN_VAIN = 16.0
"""Times what rounding leaves: a piece with that E^2 is not quartered."""
RESOLVED = 4.0
"""Times what the sum of E^2 is wanted to be: up to which it counts as that."""
FLOOR = 1e-13
"""Of ||p||: its rounding, which no smaller piece takes away."""
MOST_PIECES = 200_000
"""Of a mesh's triangles, or four times those: to be looked at, besides triangles of coarser levels."""


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
    values, sums = Values(np.zeros((n, 3)), np.zeros((n, 3)), *np.zeros((2, n))), Sums()
    halvings = min(mesh.halvings, MOST_HALVINGS)
    left = np.arange(n >> 2 * halvings)
    for k in range(halvings, -1, -1):
        if not left.size:
            break
        found = whole(mesh, left, k, data)
        squares = found.area * found.rad**2
        wanted = (sums + _sums(found.averages, found.area, squares)).wanted(_size(mesh), ABOVE if k else 1.0)
        fine = squares <= 0.5 * wanted * 4**k / n
        values.put(found, fine, mesh)
        sums += _sums(found.averages[:, fine], found.area[fine], squares[fine], 4**k)
        left = found.children(~fine) if k else left[~fine]
    if left.size:
        part = replace(mesh, triangles=mesh.triangles[left], coarse=None, halvings=0)
        of_part, sums = _in_pieces(part, data, sums, max(MOST_PIECES, 4 * n))
        for array, there in zip(values, of_part, strict=True):
            array[left] = there
    return Source(mesh, *values, resolved=sums.unknown <= RESOLVED * sums.wanted(_size(mesh)))


def _in_pieces(mesh: Mesh, data: Data, sums: Sums, left: int) -> tuple[Values, Sums]:
    """f on a part of a mesh, of the rest of which there are the sums; so many pieces may be looked at."""
    n = len(mesh.triangles)
    corners, parent, done = np.broadcast_to(np.eye(3), (n, 3, 3)), np.arange(n), []
    while parent.size:
        pieces, owner = polynomials(mesh, corners, parent, data)
        left -= len(owner)
        rest, area, of_p = _rest(mesh, pieces), areas(mesh, pieces), averages(pieces.c)
        squares = np.bincount(owner, rest, len(parent)).astype(float)
        total = sums + _sums(of_p, area, rest)
        enough = total.wanted(_size(mesh))
        wide = squares > (0.5 * enough / total.count if total.unknown > enough else np.inf)
        wide[wide] = squares[wide] > IN_VAIN * known_at_points(mesh, corners[wide], parent[wide], data)
        if 4 * np.count_nonzero(wide) > left:
            wide &= np.argsort(np.argsort(-squares)) < left // 4
        kept = ~wide[owner]
        done.append(pieces.of(kept))
        sums += _sums(of_p[:, kept], area[kept], rest[kept])
        corners, parent = quarter(corners[wide]), np.repeat(parent[wide], 4)
    return _projected(mesh, done), sums


@dataclass(frozen=True)
class Sums:
    """Over pieces: E^2, ||p||^2, the integral of p, areas; and their number."""

    unknown: float = 0.0
    square: float = 0.0
    integral: float = 0.0
    area: float = 0.0
    count: int = 0

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def wanted(self, h: float, share: float = 1.0) -> float:
        """What E^2 is wanted to be at most in all, on a mesh of that h; or a share of it, which is E's.

        It is a share of ||f - mean f||, of which p shows no more than what exceeds E.
        """
        unknown, norm = math.sqrt(self.unknown), math.sqrt(self.square)
        spread = math.sqrt(max(self.square - self.integral * (self.integral / self.area), 0.0)) - unknown
        return max(share * ENOUGH * h * spread, FLOOR * (norm - unknown), 0.0) ** 2


def _size(mesh: Mesh) -> float:
    """h of as many triangles, all alike: halves of squares."""
    return math.sqrt(2 * float(mesh.areas.sum()) / len(mesh.areas))


def _sums(of_p: Array, area: Array, squares: Array, parts: int = 1) -> Sums:
    """Of pieces with the `averages` (2, k) of p, those areas (k,) and E^2 (k,), each of so many parts."""
    integral, square = (of_p @ area).tolist()
    return Sums(float(squares.sum()), square, integral, float(area.sum()), parts * len(area))


def _rest(mesh: Mesh, pieces: Pieces) -> Array:
    """(k,) the pieces' E^2, a lack in the integral spread over their triangles."""
    return np.asarray(pieces.squares + pieces.integral**2 / mesh.areas[pieces.parent])


def _projected(mesh: Mesh, done: list[Pieces]) -> Values:
    n = len(mesh.triangles)
    moments, squares, rest, jumping, integral = np.zeros((n, 3)), *np.zeros((4, n))
    for pieces in done:
        own = areas(mesh, pieces)[:, None] * (hat_means() @ pieces.c).T
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
        squares += np.bincount(pieces.parent, pieces.outer * averages(left)[1], n)
    oscillation = np.sqrt(squares) + np.sqrt(jumping)
    return Values(f_h, moments, oscillation, np.sqrt(rest) + integral / np.sqrt(mesh.areas))
