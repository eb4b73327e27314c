"""Quadrature that sees a case's singular points and kinks.

On the boundary: Gauss points on the common refinement of given cuts and the singular points, in the
variable tau = |s - p|^(1/k) about the nearest singular point p, so that powers of s - p with exponents
in multiples of 1/k are polynomials. In Omega: a symmetric rule on every triangle or piece of `splitting`;
pieces with a singular point as their first corner are mapped (Duffy) with r = tau^k.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from math import lcm
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from unilateral.arrays import Array, Index, row_blocks
from unilateral.fem.splitting import SingularPieces, split_triangles
from unilateral.geometry.curves import SingularPoint
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import corner_coordinates
from unilateral.geometry.polygon import Polygon

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution

GAUSS_POINTS = 16
TRIANGLE_DEGREE = 8
FINE_MESH_DEGREE = 5
FINE_MESH_RATIO = 1 / 64
"""A mesh is fine if h is at most this times the shortest side, and this times four times a cutoff's radius.

h^(FINE_MESH_DEGREE + 1), in these units, is then below 2e-11.
"""
STRONG_GRADING = 2
GRADED_CUTS = 6
"""Towards a point whose grading is above STRONG_GRADING the rule is cut so often on either side."""
_gauss_rule = cache(leggauss)
"""Gauss points (n,) and their weights (n,) on [-1, 1], for n points."""


class BoundaryRule(NamedTuple):
    """Points by their side (Q,) and arc length s (Q,) from its start; their weight (Q,) and interval (Q,).

    The intervals are those between cuts. `nearest_anchor` is the nearest vertex or singular point t (Q,) of
    the side, in side lengths, and the arc length (Q,) from it, which is rounded in s.
    """

    side: Index
    s: Array
    weight: Array
    interval: Index
    nearest_anchor: tuple[Array, Array]

    def integrate(self, values: Array, n_intervals: int) -> Array:
        """The integrals (n_intervals,) over the intervals of a function with these values at the points."""
        return np.bincount(self.interval, self.weight * values, n_intervals).astype(float, copy=False)


def boundary_rule(polygon: Polygon, cuts: Array, singular: Iterable[SingularPoint] = ()) -> BoundaryRule:
    """A rule on every interval between the arc lengths `cuts` (k + 1,), which contain the vertices.

    With a case's singular points it is exact to round-off for the piecewise powers that its lambda and gap
    are made of.
    """
    anchors = _find_anchors(polygon, singular)
    breaks = _break_intervals(cuts, anchors)
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    nearest = np.searchsorted(anchors.midpoints, middle)
    p = anchors.s[nearest]
    offset, weight = _place_gauss_points(breaks, p, anchors.grading[nearest])
    # t is the place of p on the side of the interval: 0 or 1 if p is one of its vertices
    side = polygon.sides_of(middle)
    t = np.where(p == polygon.starts[side + 1], 1.0, anchors.t[nearest])
    t = np.where(p == polygon.starts[side], 0.0, t)
    interval = np.searchsorted(cuts, middle, side="right") - 1
    return BoundaryRule(
        side=np.repeat(side, GAUSS_POINTS),
        s=(p[:, None] + offset - polygon.starts[side][:, None]).ravel(),
        weight=weight.ravel(),
        interval=np.repeat(interval, GAUSS_POINTS),
        nearest_anchor=(np.repeat(t, GAUSS_POINTS), offset.ravel()),
    )


class Anchors(NamedTuple):
    """Vertices and singular points of a polygon by their arc lengths `s` (k,), increasing.

    A vertex has the `grading` 1 if it is no singular point. `t` (k,) are the places of singular points on
    their sides, in side lengths; at a vertex, which is on two sides, it says nothing.
    """

    s: Array
    grading: Array
    t: Array

    @property
    def midpoints(self) -> Array:
        """The middles (k - 1,) between anchors: between two of them one anchor is the nearest one."""
        return 0.5 * (self.s[1:] + self.s[:-1])


def _find_anchors(polygon: Polygon, singular: Iterable[SingularPoint]) -> Anchors:
    """The vertices and singular points. Singular points in one place have one grading, a common multiple."""
    grading_and_t = {s: (1, 0.0) for s in polygon.starts.tolist()}
    for p in singular:
        s = polygon.arc_length(p.side, p.t)
        grading_and_t[s] = (lcm(grading_and_t.get(s, (1, 0.0))[0], p.grading), p.t)
    places = sorted(grading_and_t)
    grading, t = np.array([grading_and_t[s] for s in places], dtype=float).T
    return Anchors(np.array(places), grading, t)


def _break_intervals(cuts: Array, anchors: Anchors) -> Array:
    """The arc lengths (l + 1,) between which Gauss points are taken: cuts, anchors, and their midpoints.

    Strongly graded anchors have further ones at fractions 2^-j of the way to the midpoints beside them. What
    multiplies the power there is then all but constant on the first interval.
    """
    shares = 0.5 ** np.arange(1, GRADED_CUTS + 1)
    breaks = [cuts, anchors.s, anchors.midpoints]
    # the midpoint that follows an anchor, and the one before it
    for s, grading in ((anchors.s[:-1], anchors.grading[:-1]), (anchors.s[1:], anchors.grading[1:])):
        strong = grading > STRONG_GRADING
        to_midpoint = anchors.midpoints[strong] - s[strong]
        breaks.append((s[strong][:, None] + to_midpoint[:, None] * shares).ravel())
    points = np.unique(np.concatenate(breaks))
    return points[(points >= cuts[0]) & (points <= cuts[-1])]


def _place_gauss_points(breaks: Array, p: Array, grading: Array) -> tuple[Array, Array]:
    """Gauss points between breaks (l + 1,) as offsets (l, q) from anchors p (l,), and their weights (l, q).

    They are those of tau = |s - p|^{1/k}, k the `grading` (l,). An anchor is no inner point of its interval.
    """
    k = grading[:, None]
    sign = np.where(0.5 * (breaks[:-1] + breaks[1:]) >= p, 1.0, -1.0)[:, None]
    tau_ends = np.abs(np.stack([breaks[:-1], breaks[1:]]) - p) ** (1 / grading)
    low = tau_ends.min(axis=0)[:, None]
    high = tau_ends.max(axis=0)[:, None]
    # s = p +- tau^k, so ds = k tau^{k-1} dtau
    x, w = _gauss_rule(GAUSS_POINTS)
    tau = low + 0.5 * (high - low) * (x + 1)
    return sign * tau**k, 0.5 * (high - low) * w * k * tau ** (k - 1)


@dataclass(frozen=True)
class TriangleRule:
    """q points in each of k pieces of triangles.

    `triangle` (k,) says whose pieces they are; `barycentric` (k, q, 3) and `weight` (k, q) belong to the
    points, whose places are `origin` + `offset` (k q, 2); where there is a singular point it is the origin.
    """

    triangle: Index
    barycentric: Array
    weight: Array
    origin: Array
    offset: Array | float = 0.0

    @property
    def points(self) -> Array:
        """The points of all pieces in the plane, rounded; shape (k q, 2)."""
        return self.origin + self.offset


def triangle_rules(mesh: Mesh, case: ExactSolution, degree: int | None = None) -> Iterator[TriangleRule]:
    """Rules which together cover the mesh, in blocks that keep memory bounded.

    If no `degree` is given it is TRIANGLE_DEGREE, or FINE_MESH_DEGREE on whole triangles of a fine mesh.
    """
    corners, parent, singular = split_triangles(mesh, case)
    whole_degree = degree or (FINE_MESH_DEGREE if _is_fine(mesh, case) else TRIANGLE_DEGREE)
    piece_degree = degree or TRIANGLE_DEGREE
    # whole triangles; then pieces at kinks; then pieces with a singular point as their first corner
    is_whole = np.ones(len(mesh.triangles), dtype=bool)
    is_whole[np.concatenate([parent, *[group.pieces.parent for group in singular]])] = False
    whole_triangles = np.flatnonzero(is_whole)
    for block in row_blocks(len(whole_triangles)):
        yield _place_whole_rule(mesh, whole_triangles[block], *symmetric_rule(whole_degree))
    for block in row_blocks(len(parent)):
        yield _place_rule(mesh, corners[block], parent[block], *symmetric_rule(piece_degree))
    for group in singular:
        yield _place_singular_rule(mesh, group, piece_degree)


def _is_fine(mesh: Mesh, case: ExactSolution) -> bool:
    """Whether FINE_MESH_DEGREE does on whole triangles: it then leaves less than 2e-11."""
    # a kink that has a radius is a cutoff's
    radii = [4 * kink.radius for kink in case.kinks() if kink.radius]
    return bool(mesh.h <= FINE_MESH_RATIO * min([mesh.polygon.lengths.min(), *radii]))


@cache
def symmetric_rule(degree: int) -> tuple[Array, Array]:
    """Barycentric points (q, 3) and weights (q,) with sum 1."""
    from skfem.quadrature import get_quadrature_tri  # which bounds on formulas do not need

    points, weights = get_quadrature_tri(degree)
    return np.column_stack([1 - points.sum(axis=0), *points]), 2 * weights


@cache
def duffy_rule(n_points: int, grading: int = 1) -> tuple[Array, Array]:
    """A rule on a triangle that is graded to its first corner, from which points are a part tau^grading away.

    It has n Gauss points across, and n times the grading in tau, but at most 4 n. Not graded it is exact for
    polynomials of degree 2 n - 2. Barycentric points and weights as `symmetric_rule`.
    """
    x, w = _gauss_rule(n_points * min(grading, 4))
    y, v = _gauss_rule(n_points)
    tau = 0.5 * (x[:, None] + 1)
    across = 0.5 * (y + 1)
    rho = tau**grading
    # the point (1 - rho) a + rho (1 - y) b + rho y c has the area element 2 |T| rho drho dy, rho = tau^k
    weight = 0.5 * rho * grading * tau ** (grading - 1) * w[:, None] * v
    points = np.stack(np.broadcast_arrays(1 - rho, rho * (1 - across), rho * across), axis=-1)
    return points.reshape(-1, 3), weight.ravel()


def _place_whole_rule(mesh: Mesh, triangles: Index, points: Array, weights: Array) -> TriangleRule:
    """The rule on whole triangles (k,), whose points in the plane are faster to find than those of pieces."""
    barycentric = np.broadcast_to(points, (len(triangles), *points.shape))
    x, y = corner_coordinates(mesh.points, mesh.triangles[triangles])
    places = np.stack([(points @ x).T, (points @ y).T], axis=-1).reshape(-1, 2)
    return TriangleRule(triangles, barycentric, np.outer(mesh.areas[triangles], weights), places)


def _place_rule(mesh: Mesh, corners: Array, parent: Index, points: Array, weights: Array) -> TriangleRule:
    """The rule on the pieces with barycentric corners (k, 3, 3) of the triangles `parent` (k,)."""
    vertices = corners @ mesh.points[mesh.triangles[parent]]
    # a piece has the fraction |a . (b x c)| of the area of its triangle
    a, b, c = np.moveaxis(corners, 1, 0)
    share = np.abs(np.sum(a * np.cross(b, c), axis=1)) * mesh.areas[parent]
    return TriangleRule(
        parent, points @ corners, np.outer(share, weights), (points @ vertices).reshape(-1, 2)
    )


def _place_singular_rule(mesh: Mesh, singular: SingularPieces, degree: int) -> TriangleRule:
    """The rule on pieces with a singular point, with offsets from it that its coordinates do not round."""
    points, weights = duffy_rule(degree, singular.grading)
    rule = _place_rule(mesh, *singular.pieces, points, weights)
    # the barycentric coordinates of the other two corners times the edges that lead to these
    edges = singular.pieces.vertices(mesh)[:, 1:] - singular.point[:, None]
    offset = (points[:, 1:] @ edges).reshape(-1, 2)
    return replace(rule, origin=np.repeat(singular.point, len(weights), axis=0), offset=offset)
