"""f on the triangles of a mesh made by refinement, from polynomials on those that they came from.

f is enclosed on the triangles of the first mesh. Where that leaves too much of f, they are replaced by those
that came from them, down to the mesh itself (`source_polynomials`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask
from unilateral.bounds.source_pieces import rounded_size
from unilateral.bounds.source_polynomials import MOST_HALVINGS, Polynomials, none, whole
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import signed_areas
from unilateral.geometry.refinement import Step
from unilateral.problems.data import Data

ENOUGH = 0.003
"""The rest of f may be as large as this times h ||p - mean p||: it falls with h, like discretisation errors.

h is that of triangles that are all alike (`even_h`).
"""
ABOVE = 0.1
"""On coarser triangles only this fraction of ENOUGH is allowed, for there it costs next to nothing."""
FLOOR = 1e-13
"""The rest of f may always be this times ||p||: that is the rounding of p, the same on smaller pieces."""


class Seen(NamedTuple):
    """Polynomials; triangle t has the one with the number of[t], found halvings[t] halvings above it.

    `of` and `halvings` are (m,).
    """

    known: Polynomials
    of: Int32
    halvings: Int32


@dataclass(frozen=True)
class Sums:
    """Sums over pieces of E^2 (E as in `source`), ||p||^2, the integral of p and the area; their number."""

    unknown: float = 0.0
    square: float = 0.0
    integral: float = 0.0
    area: float = 0.0
    count: int = 0

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def wanted(self, h: float, share: float = 1.0) -> float:
        """The largest sum of E^2 that is wanted on a mesh of that h; a `share` multiplies the wanted E.

        The wanted E is a fraction of ||f - mean f||, of which only ||p - mean p|| - E is certain.
        """
        unknown, norm = math.sqrt(self.unknown), math.sqrt(self.square)
        spread = math.sqrt(max(self.square - self.integral * (self.integral / self.area), 0.0)) - unknown
        return max(share * ENOUGH * h * spread, FLOOR * (norm - unknown), 0.0) ** 2


def even_h(mesh: Mesh) -> float:
    """The h that a mesh has if as many triangles are all alike, halves of squares."""
    return math.sqrt(2 * float(mesh.areas.sum()) / len(mesh.areas))


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

    def __init__(self, mesh: Mesh, data: Data, first: Mesh, before: Seen | None, sums: Sums) -> None:
        """Search from the `first` mesh on, with what was seen there `before`, if anything, and its sums."""
        self.mesh, self.data, self.h = mesh, data, even_h(mesh)
        self.known, self.sums, self.whole = none(), sums, before is not None
        steps, n = mesh.steps[len(first.steps) :], len(first.triangles)
        self.of, self.halvings = np.zeros((2, n), dtype=np.int32)
        self.left, self.new = np.ones((2, n), dtype=bool)
        if before:
            self.known, self.of, self.halvings = before.known, before.of.copy(), before.halvings.copy()
            self.new, self.left = ~self.left, self._wide_above(before.known.rad[before.of])
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
        """Enclose f on the triangles with those nodes (k, 3) and the numbers `at` (k,)."""
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
        """The sums with those over triangles of these areas (k,) added, unless they contain these already."""
        if self.whole:
            return self.sums
        return self.sums + sums_of(found.averages(), area, area * found.rad**2)

    def _wide_above(self, rad: Array, sums: Sums | None = None) -> Mask:
        """(k,) where rad (k,) would be too large if all triangles of the mesh had it."""
        wanted = (sums or self.sums).wanted(self.h, ABOVE)
        return np.asarray(rad**2 * float(self.mesh.areas.sum()) > 0.5 * wanted)

    def wide(self) -> Mask:
        """(m,) where rad is too large on the mesh.

        Half of what is wanted is shared out among the triangles by area, the other half equally.
        """
        area, n = self.mesh.areas, len(self.mesh.triangles)
        rad, left = self.known.rad[self.of], np.flatnonzero(self.left & self.new)
        wanted = self._with(self.known.of(self.of[left]), area[left]).wanted(self.h)
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
