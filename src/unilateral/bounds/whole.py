"""f on whole triangles: those of a mesh, and those that they came from by uniform refinement.

On a triangle of a coarser level f is a polynomial p, |f - p| <= rad. So it is on all triangles of the mesh
that lie in it. Their nodes are midpoints, which are rounded: in the variables of p, x and y are affine up to
half an EPS of their size for every halving. rad holds up to ROUNDING of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.pieces import BLOCK, on_triangles, rounded_size, with_gaps
from unilateral.bounds.projection import ORDER, averages, halved, projected, rounding
from unilateral.formulas.taylor import basis
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import signed_areas
from unilateral.problems.data import Data

MOST_HALVINGS = 6
"""Between a mesh and the coarsest level on which f is looked at; 8 of them would be ROUNDING."""


class Whole(NamedTuple):
    """p's c (m, k) and a bound rad (k,) of |f - p| on triangles (k,), `halvings` levels above the mesh.

    `rad` has what rounding does to p on the mesh's triangles. `first` (k,) is the corner of sigma = (-1, -1).
    `averages` (2, k) are the means of p and p^2.
    """

    triangle: Index
    halvings: int
    area: Array
    c: Array
    averages: Array
    rad: Array
    first: Index

    def children(self, of: Mask) -> Index:
        """Of some of the triangles."""
        return (4 * self.triangle[of][:, None] + np.arange(4)).ravel()


def whole(mesh: Mesh, triangle: Index, halvings: int, data: Data) -> Whole:
    """f on the triangles (k,) of the level from which so many halvings made the mesh."""
    k, corner, every, size = len(triangle), np.arange(3), 4**halvings, rounded_size(mesh)
    c, of_p = np.empty((len(basis(2, ORDER).degree), k)), np.empty((2, k))
    area, rad, first = *np.empty((2, k)), np.empty(k, dtype=np.intp)
    for start in range(0, k, BLOCK):
        of = slice(start, start + BLOCK)
        nodes = mesh.triangles[every * triangle[of, None] + (every - 1) // 3 * corner, corner]
        c[:, of], rad[of], first[of] = on_triangles(mesh.points[nodes], size, data)
        area[of], of_p[:, of] = signed_areas(mesh.points, nodes), averages(c[:, of])
        rad[of] += rounding(c[:, of], halvings)
    return Whole(triangle, halvings, area, c, of_p, rad, first)


class Values(NamedTuple):
    """What is known of f on every triangle of the mesh; see `Source`."""

    f_h: Array
    moments: Array
    oscillation: Array
    rest: Array

    def put(self, of: Whole, chosen: Mask, mesh: Mesh) -> None:
        """p on all triangles of the mesh that lie in the chosen ones."""
        parts = 4**of.halvings
        for first in range(3):
            here = np.flatnonzero(chosen & (of.first == first))
            step = max(1, BLOCK // parts)
            for start in range(0, len(here), step):
                some = here[start : start + step]
                at = (parts * of.triangle[some][:, None] + np.arange(parts)).ravel()
                c = halved(np.ascontiguousarray(of.c[:, some].T), of.halvings, first)
                self._put(mesh, at, *projected(c, first), np.repeat(of.rad[some], parts))

    def _put(self, mesh: Mesh, at: Index, f_h: Array, squares: Array, rad: Array) -> None:
        area = mesh.areas[at]
        self.f_h[at] = f_h
        self.moments[at] = area[:, None] / 12 * (f_h + f_h.sum(axis=1, keepdims=True))
        self.oscillation[at] = np.sqrt(area * squares)
        outer = with_gaps(area, 3 * mesh.longest_edges[at], rounded_size(mesh))
        self.rest[at] = np.sqrt(outer) * rad
