"""f on the triangles of a mesh made by refinement, from polynomials on those that they came from.

f is enclosed on the triangles of the first mesh. Where that leaves too much, those give way to the ones that
came from them, down to the mesh itself (`whole`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Int32, Mask
from unilateral.bounds.pieces import rounded_size
from unilateral.bounds.whole import MOST_HALVINGS, Polynomials, none, whole
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import signed_areas
from unilateral.geometry.refinement import Step
from unilateral.problems.data import Data

ENOUGH = 0.003
"""Of h ||p - mean p||, like discretisation errors: what the rest of f may be; h of triangles all alike."""
ABOVE = 0.1
"""Of that: on coarser triangles, where it costs next to nothing."""
FLOOR = 1e-13
"""Of ||p||: its rounding, which no smaller piece takes away."""


class Seen(NamedTuple):
    """Polynomials; the triangles have those `of` (m,), found so many `halvings` (m,) above."""

    known: Polynomials
    of: Int32
    halvings: Int32


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


def even_h(mesh: Mesh) -> float:
    """h of as many triangles, all alike: halves of squares."""
    return math.sqrt(2 * float(mesh.areas.sum()) / len(mesh.areas))


def sums_of(of_p: Array, area: Array, squares: Array) -> Sums:
    """Of pieces with the `averages` (2, k) of p, those areas (k,) and E^2 (k,)."""
    integral, square = (of_p @ area).tolist()
    return Sums(float(squares.sum()), square, integral, float(area.sum()), len(area))


class AncestorSearch:
    """From the triangles of the first mesh, or of the one `before`, to those that came from them.

    On the mesh in hand the triangles have the polynomials `of` (m,), found so many `halvings` (m,) above. Of
    those that are `left` (m,) they are not near enough; `new` (m,) are those whose polynomials are new.
    `sums` are over triangles where p is near enough, or over the `whole` mesh before.
    """

    def __init__(self, mesh: Mesh, data: Data, first: Mesh, before: Seen | None, sums: Sums) -> None:
        """From the `first` mesh, from what was seen there `before`, if it was, and the sums over it."""
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
        return self.sums + sums_of(found.averages(), area, area * found.rad**2)

    def _wide_above(self, rad: Array, sums: Sums | None = None) -> Mask:
        """(k,) where rad (k,) is more than the triangles of the mesh in all should have: alike everywhere."""
        wanted = (sums or self.sums).wanted(self.h, ABOVE)
        return np.asarray(rad**2 * float(self.mesh.areas.sum()) > 0.5 * wanted)

    def wide(self) -> Mask:
        """(m,) where rad is too large on the mesh: half of what is wanted goes by areas, half by numbers."""
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
