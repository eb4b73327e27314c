"""f on a mesh, enclosed: its linear part on every triangle, and a bound of what the rest can do.

On a piece f is a polynomial p, |f - p| <= rad (`taylor`). On a mesh made by refinement the first pieces are
the triangles of the first mesh; where rad is not small they give way to those that came from them (`whole`).
Triangles of the mesh itself are cut at a jump, where the bound holds but for a part whose area is bounded
(`jumps`). Pieces are quartered until sum |piece| rad^2 is small, so that no peak of f can hide between
points. With f_h the L2 projection of p to linear functions on each triangle T, and E_T >= ||f - p||_T,

    (f - f_h, w)_T <= d_T/j ||p - f_h||_T |w|_{1,T} + E_T ||w||_T,

d_T the diameter of T and j = 3.83.. the first zero of the Bessel function J_1: the optimal constant in
Poincare's inequality for triangles of that diameter (Laugesen and Siudeja, J. Differential Equations 249,
2010).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask, blocks
from unilateral.bounds.pieces import (
    Pieces,
    areas,
    known_at_points,
    polynomials,
    rounded_size,
    with_gaps,
)
from unilateral.bounds.projection import averages, hat_means
from unilateral.bounds.quadratic import linear_squares
from unilateral.bounds.whole import FEW, MOST_HALVINGS, Polynomials, none, values, whole
from unilateral.fem.splitting import quarter
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import signed_areas
from unilateral.geometry.refinement import Step
from unilateral.problems.data import Data

J = 3.8317
"""The first zero of J_1, 3.83170597.., rounded down."""
ENOUGH = 0.003
"""Of h ||p - mean p||, like discretisation errors: what the rest of f may be; h of triangles all alike."""
ABOVE = 0.1
"""Of that: on coarser triangles, where it costs next to nothing."""
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

    `seen` is where p was found.
    """

    mesh: Mesh
    f_h: Array
    oscillation: Array
    rest: Array
    resolved: bool = True
    seen: Seen | None = None

    @property
    def moments(self) -> Array:
        """(m, 3) those of f_h, and of p, with the triangles' hats."""
        return self.moments_on(slice(None))

    @property
    def load(self) -> Array:
        """(n,) values of (f_h, phi_i)."""
        found, nodes = np.zeros(self.mesh.n_nodes), self.mesh.triangles
        for of in blocks(len(nodes)):
            np.add.at(found, nodes[of].ravel(), self.moments_on(of).ravel())
        return found

    def moments_on(self, of: slice) -> Array:
        """(k, 3) the same of some triangles."""
        f_h = self.f_h[of]
        return self.mesh.areas[of, None] / 12 * (f_h + f_h.sum(axis=1, keepdims=True))

    @property
    def distance(self) -> float:
        """A bound of the norm of f - f_h in the dual of H^1."""
        return self.distance_with(0.0)

    def distance_with(self, more: Array | float) -> float:
        """The same for f - f_h and functions with mean 0 and those norms (m,) on the triangles together."""
        return math.sqrt(self.squares_with(more).sum())

    def squares_with(self, more: Array | float, of: slice = slice(None)) -> Array:
        """(k,) some triangles' parts of its square, for `more` (k,) of these."""
        free, rest = self.oscillation[of] + more, self.rest[of]
        apart = (poincare(self.mesh.longest_edges[of]) * free) ** 2 + rest**2
        return np.asarray(np.minimum(apart, (free + rest) ** 2))

    @property
    def unknown(self) -> float:
        """What of that is f - p, whose means are not known."""
        return float(np.linalg.norm(self.rest))


def poincare(longest: Array) -> Array:
    """(k,) the constants C of ||w - mean w||_T <= C |w|_{1,T}, for triangles of these longest edges (k,)."""
    return longest / J


class Seen(NamedTuple):
    """Polynomials; the triangles have those `of` (m,), found so many `halvings` (m,) above."""

    known: Polynomials
    of: Int32
    halvings: Int32


class Values(NamedTuple):
    """What is known of f on every triangle of a mesh; see `Source`."""

    f_h: Array
    oscillation: Array
    rest: Array

    def put(self, mesh: Mesh, at: Index, seen: Seen) -> None:
        """Of the polynomials, on the triangles `at` (k,)."""
        size, places = rounded_size(mesh), np.ascontiguousarray(mesh.points.T)
        for some in (at[of] for of in blocks(len(at), FEW)):
            area, of = mesh.areas[some], seen.of[some]
            f_h, squares = values(places[:, mesh.triangles[some].T], seen.known, of)
            outer = with_gaps(area, 3 * mesh.longest_edges[some], size)
            self.f_h[some], self.oscillation[some] = f_h.T, np.sqrt(area * squares)
            self.rest[some] = np.sqrt(outer) * seen.known.rad[of]

    def sums(self, mesh: Mesh, of: Mask) -> Sums:
        """Over some of the triangles."""
        if not of.any():
            return Sums()
        area, means = mesh.areas[of], self.f_h[of].mean(axis=1)
        squares = linear_squares(area, self.f_h[of]) + self.oscillation[of] ** 2
        unknown = float(np.sum(self.rest[of] ** 2))
        return Sums(unknown, float(squares.sum()), float(area @ means), float(area.sum()), len(area))


def enclosed(mesh: Mesh, data: Data, before: Source | None = None) -> Source:
    """f on the mesh; `rest` is infinite where f has no bound, and large where the pieces did not suffice.

    What is known on a mesh `before`, from which this one was refined, is kept where that is enough.
    """
    n = len(mesh.triangles)
    values = Values(np.empty((n, 3)), *np.empty((2, n)))
    if before:
        for array, old in zip(values, _values(before), strict=True):
            array[: len(old)] = old
    search = _Search(mesh, data, before)
    wide = search.wide()
    values.put(mesh, np.flatnonzero(search.new & ~wide), search.seen)
    left = np.flatnonzero(search.new & wide)
    sums = search.sums
    if left.size:
        known = values.sums(mesh, ~(search.new & wide))
        of_part, sums = _in_pieces(mesh.part(left), data, known, max(MOST_PIECES, 4 * n))
        for array, there in zip(values, of_part, strict=True):
            array[left] = there
    resolved = float(values.rest @ values.rest) <= RESOLVED * sums.wanted(_size(mesh))
    return Source(mesh, *values, resolved=resolved, seen=search.seen)


def _values(of: Source) -> Values:
    return Values(of.f_h, of.oscillation, of.rest)


class _Search:
    """From the triangles of the first mesh, or of the one `before`, to those that came from them.

    On the mesh in hand the triangles have the polynomials `of` (m,), found so many `halvings` (m,) above. Of
    those that are `left` (m,) they are not near enough; `new` (m,) are those whose polynomials are new.
    `sums` are over triangles where p is near enough, or over the `whole` mesh before.
    """

    def __init__(self, mesh: Mesh, data: Data, before: Source | None) -> None:
        self.mesh, self.data, self.size = mesh, data, _size(mesh)
        self.known, self.sums, self.whole = none(), Sums(), False
        first = before.mesh if before else mesh.coarse or mesh
        steps, n = mesh.steps[len(first.steps) :], len(first.triangles)
        self.of, self.halvings = np.zeros((2, n), dtype=np.int32)
        self.left, self.new = np.ones((2, n), dtype=bool)
        if before and before.seen:
            self.known, self.of, self.halvings = before.seen
            self.of, self.halvings = self.of.copy(), self.halvings.copy()
            self.sums, self.new, self.whole = _values(before).sums(first, self.left), ~self.left, True
            self.left = self._wide_above(self.known.rad[self.of])
            asked = self.left & (self.halvings > 0) & _cut(steps, n)
        else:
            asked = self.left
        self._ask(first.triangles[asked], np.flatnonzero(asked))
        for step in steps:
            again = self.left[step.parent] | (self.halvings[step.parent] == MOST_HALVINGS)
            self.of, self.halvings = step.inherited(self.of), step.inherited(self.halvings)
            self.left, self.new = step.inherited(self.left), step.inherited(self.new)
            self.halvings[step.triangles] += 1
            self.new[step.triangles] = True
            self._ask(step.nodes[again], step.triangles[again])

    @property
    def seen(self) -> Seen:
        return Seen(self.known, self.of, self.halvings)

    def _ask(self, nodes: Index, at: Index) -> None:
        """For f on triangles with those nodes (k, 3) and numbers (k,)."""
        if not at.size:
            return
        found = whole(self.mesh.points[nodes], rounded_size(self.mesh), self.data)
        self.of[at] = len(self.known.rad) + np.arange(len(at))
        self.known, self.halvings[at], self.new[at] = self.known.and_more(found), 0, True
        area = signed_areas(self.mesh.points, nodes)
        self.left[at] = self._wide_above(found.rad, self._with(found, area))
        if not self.whole:
            fine = np.flatnonzero(~self.left[at])
            self.sums = self._with(found.of(fine), area[fine])

    def _with(self, found: Polynomials, area: Array) -> Sums:
        """The sums, and those over triangles with these areas (k,), unless they are in them."""
        if self.whole:
            return self.sums
        return self.sums + _sums(found.averages(), area, area * found.rad**2)

    def _wide_above(self, rad: Array, sums: Sums | None = None) -> Mask:
        """(k,) where rad (k,) is more than the triangles of the mesh in all should have: alike everywhere."""
        wanted = (sums or self.sums).wanted(self.size, ABOVE)
        return np.asarray(rad**2 * float(self.mesh.areas.sum()) > 0.5 * wanted)

    def wide(self) -> Mask:
        """(m,) where rad is too large on the mesh: half of what is wanted goes by areas, half by numbers."""
        area, n = self.mesh.areas, len(self.mesh.triangles)
        rad, left = self.known.rad[self.of], np.flatnonzero(self.left & self.new)
        wanted = self._with(self.known.of(self.of[left]), area[left]).wanted(self.size)
        share = 0.5 * (area / float(area.sum()) + 1 / n)
        found = self.left & (area * rad**2 > 0.5 * wanted * share)
        fine = left[~found[left]]
        self.sums = self._with(self.known.of(self.of[fine]), area[fine])
        return np.asarray(found)


def _cut(steps: Sequence[Step], n: int) -> Mask:
    """(n,) which of the first n triangles are cut."""
    found = np.zeros(n, dtype=bool)
    for step in steps:
        found[step.parent[step.parent < n]] = True
    return found


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
        for sums, each in (
            (rest, pieces.squares),
            (jumping, pieces.jumping**2),
            (integral, pieces.integral),
        ):
            sums += np.bincount(pieces.parent, each, n)
    f_h = (12 * moments - 3 * moments.sum(axis=1, keepdims=True)) / mesh.areas[:, None]
    for pieces in done:
        a, b, c = np.einsum("kib,kb->ik", pieces.corners, f_h[pieces.parent])
        left = pieces.c.copy()
        left[:3] -= 0.5 * np.stack([b + c, c - a, b - a])  # of degree 1: (0, 1), (1, 0)
        squares += np.bincount(pieces.parent, pieces.outer * averages(left)[1], n)
    oscillation = np.sqrt(squares) + np.sqrt(jumping)
    return Values(f_h, oscillation, np.sqrt(rest) + integral / np.sqrt(mesh.areas))
