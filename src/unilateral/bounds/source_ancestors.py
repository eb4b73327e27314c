"""f on the triangles of a mesh made by refinement, from polynomials on those that they came from.

f is enclosed on the triangles of the first mesh. Where that leaves too much of f, they are replaced by those
that came from them, down to the mesh itself.

On a triangle f is near a polynomial p, |f - p| <= rad. This holds on all triangles of a mesh that lie in it.
In p's variables (`source_pieces`) the corners of the smaller triangles are multiples of FINEST, for each
halving of an edge halves the differences. In memory nodes are rounded midpoints: every halving rounds them by
half an EPS of their size. rad holds for coordinates that are rounded by up to ROUNDING of their size, so p is
used on triangles that are up to MOST_HALVINGS halvings finer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask, blocks
from unilateral.bounds.source_pieces import ORDER, averages, on_triangles, rounded_size
from unilateral.fem.quadrature import symmetric
from unilateral.formulas.taylor import EPS, basis
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import signed_areas
from unilateral.geometry.refinement import Step
from unilateral.problems.problem import SourceFunction

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
ENOUGH = 0.003
"""The rest of f may be as large as this times `resolution` times ||p - mean p||.

It falls with h, like discretisation errors.
"""
ABOVE = 0.1
"""On coarser triangles only this fraction of ENOUGH is allowed, for there it costs next to nothing."""
FLOOR = 1e-13
"""The rest of f may always be this times ||p||: that is the rounding of p, the same on smaller pieces."""


class Polynomials(NamedTuple):
    """p on triangles by its c (m, k), and rad (k,); `frame` (6, k) is the map from places to p's variables.

    Take a place less the last two rows. Its products with the first two rows and with the next two are, but
    for rounding, the two variables, in units of FINEST.
    """

    c: Array
    rad: Array
    frame: Array

    def of(self, chosen: Index) -> Polynomials:
        """The polynomials that are chosen (k,)."""
        return Polynomials(*(each[..., chosen] for each in self))


def none() -> Polynomials:
    return Polynomials(np.empty((len(basis(2, ORDER).degree), 0)), np.empty(0), np.empty((6, 0)))


def joined(several: Sequence[Polynomials]) -> Polynomials:
    return Polynomials(*(np.concatenate(each, axis=-1) for each in zip(*several, strict=True)))


def whole(corners: Array, size: float, f: SourceFunction) -> Polynomials:
    """f on triangles with those corners (k, 3, 2), of a mesh of that `rounded_size`."""
    known = []
    for of in blocks(len(corners)):
        c, rad, ordered = on_triangles(corners[of], size, f)
        frame = _frame(*ordered.transpose(1, 2, 0))
        known.append(Polynomials(c, rad + COMPUTED * EPS * np.abs(c).sum(axis=0), frame))
    return joined(known)


def _frame(a: Array, u: Array, v: Array) -> Array:
    """(6, k) the `frame` of triangles with those corners (2, k), in units of FINEST."""
    e = 0.5 * (u - a)
    f = 0.5 * (v - a)
    scale = 1 / (FINEST * (e[0] * f[1] - e[1] * f[0]))
    return np.stack([f[1] * scale, -f[0] * scale, -e[1] * scale, e[0] * scale, *(0.5 * (u + v))])


def values(corners: Array, known: Polynomials, of: Int32) -> tuple[Array, Array]:
    """(3, k) the L2 projection f_h of p at the corners (2, 3, k), (k,) the mean of (p - f_h)^2.

    `of` (k,) says which p is known on each triangle. Where refinement was uniform, triangles in a row lie
    alike in those around them.
    """
    places = np.concatenate(inside(corners, known.frame[:, of]))
    c = known.c[:, of]
    change = np.flatnonzero((places[:, 1:] != places[:, :-1]).any(axis=0)) + 1
    if LONG * (len(change) + 1) > len(of):
        return _one_by_one(places, c)
    starts = [0, *change.tolist()]
    f_h = np.empty((3, len(of)))
    squares = np.empty(len(of))
    runs = itertools.starmap(slice, itertools.pairwise([*starts, len(of)]))
    for run, to_f_h, to_rest in zip(runs, *_matrices(places[:, starts]), strict=True):
        f_h[:, run] = to_f_h @ c[:, run]
        squares[run] = np.sum((to_rest @ c[:, run]) ** 2, axis=0)
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
    x = hats @ places[:3]
    y = hats @ places[3:]
    powers = [(x**i, y**i) for i in range(ORDER + 1)]
    monomials = np.stack([powers[i][0] * powers[j][1] for i, j in basis(2, ORDER).exponents]).T
    to_f_h = _to_corners() @ monomials
    return to_f_h, np.sqrt(weights)[:, None] * (monomials - hats @ to_f_h)


def inside(corners: Array, frame: Array) -> tuple[Array, Array]:
    """(3, k), (3, k) the exact variables of p at the corners (2, 3, k), for that `frame` (6, k)."""
    xx, xy, yx, yy, *middle = frame
    x = corners[0] - middle[0]
    y = corners[1] - middle[1]
    return FINEST * np.rint(xx * x + xy * y), FINEST * np.rint(yx * x + yy * y)


def _horner(c: Array, x: Array, y: Array) -> Array:
    """(q, k) the polynomials c (m, k) at x, y (q, k)."""
    number = {(i, j): k for k, (i, j) in enumerate(basis(2, ORDER).exponents.tolist())}
    p = np.zeros_like(x)
    for j in range(ORDER, -1, -1):
        of_x = np.zeros_like(x)
        for i in range(ORDER - j, -1, -1):
            of_x *= x
            of_x += c[number[i, j]]
        p *= y
        p += of_x
    return p


@cache
def _to_corners() -> Array:
    """(3, q) the matrix from values at the points of the rule to f_h at the corners."""
    hats, weights = symmetric(2 * ORDER)
    return np.asarray((weights[:, None] * (12 * hats - 3)).T)


class Seen(NamedTuple):
    """Polynomials; triangle t has the one with the number of[t], found halvings[t] halvings above it.

    `of` and `halvings` are (m,).
    """

    known: Polynomials
    of: Int32
    halvings: Int32


@dataclass(frozen=True)
class Sums:
    """Sums over pieces: of E^2 (E as in `source`), ||p||^2, the integral of p and the area; their number."""

    unknown: float = 0.0
    square: float = 0.0
    integral: float = 0.0
    area: float = 0.0
    count: int = 0

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def wanted(self, resolution: float, share: float = 1.0) -> float:
        """The largest sum of E^2 that is wanted on a mesh of that `resolution`; a `share` multiplies E.

        The wanted E is a fraction of ||f - mean f||, of which only ||p - mean p|| - E is certain.
        """
        unknown = math.sqrt(self.unknown)
        norm = math.sqrt(self.square)
        spread = math.sqrt(max(self.square - self.integral * (self.integral / self.area), 0.0)) - unknown
        return max(share * ENOUGH * resolution * spread, FLOOR * (norm - unknown), 0.0) ** 2


def resolution(mesh: Mesh, length: float) -> float:
    """h over a length, at most 1, for the h that a mesh has if its triangles are alike, halves of squares.

    In a bound E counts by ||z||_0 and a rest with mean 0 by h |z|_1. ||z||_0 is at most `Form.length` times
    ||z|| where |z|_1 is at most ||z||.
    """
    return min(math.sqrt(2 * float(mesh.areas.sum()) / len(mesh.areas)) / length, 1.0)


def sums_of(of_p: Array, area: Array, squares: Array) -> Sums:
    """The sums over pieces, from the `averages` (2, k) of p, the areas (k,) and E^2 (k,)."""
    integral, square = (of_p @ area).tolist()
    return Sums(float(squares.sum()), square, integral, float(area.sum()), len(area))


class AncestorSearch:
    """The search for p, from the triangles of the first mesh, or of that `before`, to those made from them.

    On the mesh in hand each triangle has the polynomial with the number in `of` (m,), found `halvings` (m,)
    halvings above it. `left` (m,) marks the triangles whose polynomial is not near enough, `new` (m,) those
    whose polynomial is new. `sums` are over the triangles where p is near enough or, if `whole`, over all of
    the mesh before.
    """

    def __init__(
        self,
        mesh: Mesh,
        f: SourceFunction,
        resolution: float,
        first: Mesh,
        before: Seen | None,
        sums: Sums,
    ) -> None:
        """Search from the `first` mesh on, with what was seen there `before`, if anything, and its sums."""
        self.mesh = mesh
        self.f = f
        self.resolution = resolution
        self.known = none()
        self.sums = sums
        self.whole = before is not None
        steps = mesh.steps[len(first.steps) :]
        n = len(first.triangles)
        self.of, self.halvings = np.zeros((2, n), dtype=np.int32)
        self.left, self.new = np.ones((2, n), dtype=bool)
        if before:
            self.known = before.known
            self.of = before.of.copy()
            self.halvings = before.halvings.copy()
            self.new = ~self.left
            self.left = self._wide_above(before.known.rad[before.of])
            asked = self.left & (self.halvings > 0) & _cut(steps, n)
        else:
            asked = self.left
        self._ask(first.triangles[asked], np.flatnonzero(asked))
        for step in steps:
            again = self.left[step.parent] | (self.halvings[step.parent] == MOST_HALVINGS)
            self.of = step.inherited(self.of)
            self.halvings = step.inherited(self.halvings)
            self.left = step.inherited(self.left)
            self.new = step.inherited(self.new)
            self.halvings[step.triangles] += 1
            self.new[step.triangles] = True
            self._ask(step.nodes[again], step.triangles[again])

    @property
    def seen(self) -> Seen:
        return Seen(self.known, self.of, self.halvings)

    def _ask(self, nodes: Index, at: Index) -> None:
        """Enclose f on the triangles with those nodes (k, 3) and the numbers `at` (k,)."""
        if not at.size:
            return
        asked = whole(self.mesh.points[nodes], rounded_size(self.mesh), self.f)
        self.of[at] = len(self.known.rad) + np.arange(len(at))
        self.known = joined([self.known, asked])
        self.halvings[at] = 0
        self.new[at] = True
        area = signed_areas(self.mesh.points, nodes)
        self.left[at] = self._wide_above(asked.rad, self._with(asked, area))
        fine = np.flatnonzero(~self.left[at])
        self.sums = self._with(asked.of(fine), area[fine])

    def _with(self, known: Polynomials, area: Array) -> Sums:
        """The sums with those over triangles of these areas (k,) added, unless they contain these already."""
        if self.whole:
            return self.sums
        return self.sums + sums_of(averages(known.c), area, area * known.rad**2)

    def _wide_above(self, rad: Array, sums: Sums | None = None) -> Mask:
        """(k,) where rad (k,) would be too large if all triangles of the mesh had it."""
        wanted = (sums or self.sums).wanted(self.resolution, ABOVE)
        return np.asarray(rad**2 * float(self.mesh.areas.sum()) > 0.5 * wanted)

    def wide(self) -> Mask:
        """(m,) where rad is too large on the mesh.

        Half of what is wanted is shared out among the triangles by area, the other half equally.
        """
        area = self.mesh.areas
        n = len(self.mesh.triangles)
        rad = self.known.rad[self.of]
        left = np.flatnonzero(self.left & self.new)
        wanted = self._with(self.known.of(self.of[left]), area[left]).wanted(self.resolution)
        share = 0.5 * (area / float(area.sum()) + 1 / n)
        wide = self.left & (area * rad**2 > 0.5 * wanted * share)
        fine = left[~wide[left]]
        self.sums = self._with(self.known.of(self.of[fine]), area[fine])
        return np.asarray(wide)


def _cut(steps: Sequence[Step], n: int) -> Mask:
    """(n,) which of the first n triangles are cut."""
    cut = np.zeros(n, dtype=bool)
    for step in steps:
        cut[step.parent[step.parent < n]] = True
    return cut
