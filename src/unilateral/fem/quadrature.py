"""Quadrature that sees a case's singular points and kinks.

On the boundary: Gauss points on the common refinement of given cuts and the singular points, in the
variable tau = |s - p|^(1/k) about the nearest singular point p, so that powers of s - p with exponents
in multiples of 1/k are polynomials. In Omega: a symmetric rule on every triangle; triangles that a kink
crosses are subdivided, triangles near a singular point are subdivided towards it, and those that contain
it are split there and mapped (Duffy) with r = tau^k.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from math import lcm
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, row_blocks
from unilateral.fem.splitting import split_triangles
from unilateral.geometry.curves import SingularPoint
from unilateral.geometry.mesh import Mesh
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
    anchors, grading, anchor_t = _anchors(polygon, singular)
    midpoints = 0.5 * (anchors[1:] + anchors[:-1])
    breaks = np.union1d(
        cuts, np.concatenate([anchors, midpoints, *_cut_towards_anchors(anchors, midpoints, grading)])
    )
    # intervals [a, b] between breaks, each with its nearest anchor p, whose grading is k
    breaks = breaks[(breaks >= cuts[0]) & (breaks <= cuts[-1])]
    a = breaks[:-1]
    b = breaks[1:]
    middle = 0.5 * (a + b)
    nearest = np.searchsorted(midpoints, middle)
    p = anchors[nearest]
    k = grading[nearest][:, None]
    sign = np.where(middle >= p, 1.0, -1.0)[:, None]
    tau_ends = np.abs(np.stack([a, b]) - p) ** (1 / k[:, 0])
    # Gauss points in tau = |s - p|^{1/k}: s = p +- tau^k, ds = k tau^{k-1} dtau
    x, w = _gauss_rule(GAUSS_POINTS)
    low = tau_ends.min(axis=0)[:, None]
    high = tau_ends.max(axis=0)[:, None]
    tau = low + 0.5 * (high - low) * (x + 1)
    offset = sign * tau**k
    s = p[:, None] + offset
    weight = 0.5 * (high - low) * w * k * tau ** (k - 1)
    # t is the place of p on the side of the interval: 0 or 1 if p is one of its vertices
    side = polygon.sides_of(middle)
    interval = np.searchsorted(cuts, middle, side="right") - 1
    t = np.where(
        p == polygon.starts[side], 0.0, np.where(p == polygon.starts[side + 1], 1.0, anchor_t[nearest])
    )
    return BoundaryRule(
        side=np.repeat(side, GAUSS_POINTS),
        s=(s - polygon.starts[side][:, None]).ravel(),
        weight=weight.ravel(),
        interval=np.repeat(interval, GAUSS_POINTS),
        nearest_anchor=(np.repeat(t, GAUSS_POINTS), offset.ravel()),
    )


def _anchors(polygon: Polygon, singular: Iterable[SingularPoint]) -> tuple[Array, Array, Array]:
    """Arc lengths of the vertices and singular points, increasing, their gradings, and places t on a side."""
    grading_and_t = {s: (1, 0.0) for s in polygon.starts.tolist()}
    for p in singular:
        s = polygon.arc_length(p.side, p.t)
        grading_and_t[s] = (lcm(grading_and_t.get(s, (1, 0.0))[0], p.grading), p.t)
    anchors = np.array(sorted(grading_and_t))
    grading, place = np.array([grading_and_t[s] for s in anchors.tolist()], dtype=float).T
    return anchors, grading, place


def _cut_towards_anchors(anchors: Array, between: Array, grading: Array) -> list[Array]:
    """Points at fractions 2^-j of the way from strongly graded anchors to the middles beside them.

    What multiplies the power there is then all but constant on the first interval.
    """
    shares = 0.5 ** np.arange(1, GRADED_CUTS + 1)
    strong = grading > STRONG_GRADING
    after = strong[:-1]
    before = strong[1:]
    return [
        (a[:, None] + (m - a)[:, None] * shares).ravel()
        for a, m in ((anchors[:-1][after], between[after]), (anchors[1:][before], between[before]))
    ]


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
    special = np.zeros(len(mesh.triangles), dtype=bool)
    special[parent] = True
    for pieces in singular:
        special[pieces.parent] = True
    regular = np.flatnonzero(~special)
    radii = [4 * kink.radius for kink in case.kinks() if kink.radius]
    fine = mesh.h <= FINE_MESH_RATIO * min([mesh.polygon.lengths.min(), *radii])
    whole_degree = degree or (FINE_MESH_DEGREE if fine else TRIANGLE_DEGREE)
    piece_degree = degree or TRIANGLE_DEGREE
    # whole triangles; then pieces at kinks; then pieces with a singular point as their first corner
    for block in row_blocks(len(regular)):
        index = regular[block]
        unit_corners = np.broadcast_to(np.eye(3), (len(index), 3, 3))
        yield _place_rule(mesh, unit_corners, index, *symmetric_rule(whole_degree))
    for block in row_blocks(len(parent)):
        yield _place_rule(mesh, corners[block], parent[block], *symmetric_rule(piece_degree))
    for pieces in singular:
        points, weights = duffy_rule(piece_degree, pieces.grading)
        rule = _place_rule(mesh, pieces.corners, pieces.parent, points, weights)
        # offsets from the singular point, not rounded by its coordinates
        edges = pieces.corners[:, 1:] @ mesh.points[mesh.triangles[pieces.parent]] - pieces.point[:, None]
        offset = (points[:, 1:] @ edges).reshape(-1, 2)
        yield replace(rule, origin=np.repeat(pieces.point, len(weights), axis=0), offset=offset)


@cache
def symmetric_rule(degree: int) -> tuple[Array, Array]:
    """Barycentric points (q, 3) and weights (q,) with sum 1."""
    from skfem.quadrature import get_quadrature_tri  # which bounds on formulas do not need

    points, weights = get_quadrature_tri(degree)
    return np.column_stack([1 - points.sum(axis=0), *points]), 2 * weights


@cache
def _gauss_rule(n_points: int) -> tuple[Array, Array]:
    """Points (n,) and weights (n,) on [-1, 1]."""
    return np.polynomial.legendre.leggauss(n_points)


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


def _place_rule(mesh: Mesh, corners: Array, parent: Index, points: Array, weights: Array) -> TriangleRule:
    """The rule on the pieces with barycentric corners (k, 3, 3) of the triangles `parent` (k,)."""
    vertices = corners @ mesh.points[mesh.triangles[parent]]
    # a piece has the fraction |a . (b x c)| of the area of its triangle
    a, b, c = np.moveaxis(corners, 1, 0)
    share = np.abs(np.sum(a * np.cross(b, c), axis=1)) * mesh.areas[parent]
    return TriangleRule(
        parent, points @ corners, np.outer(share, weights), (points @ vertices).reshape(-1, 2)
    )
