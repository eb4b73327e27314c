"""Super-means: lower bounds on u - g on sides with contact, as u is not below its means over half discs.

Let x be a point of a side with contact, and B a half disc of radius rho about x that lies in the domain and
meets no other side. With t = r^2 / rho^2 the weight omega = 6 (1 - t)^2 / (pi rho^2) has the integral 1, and

    2 pi W = -ln t - 3 (1 - t) + 3 (1 - t^2) / 2 - (1 - t^3) / 3

is positive in B, vanishes on the circle with its gradient, and -Laplace W is the unit mass at x less omega.
So u(x) is int omega u + (int (f - c u) W + <lambda, W>) / k. With lambda >= 0, int W = rho^2 / 16, and
e = u - u_h it follows that

    u(x) >= int omega u_h + rho^2 / (16 k) min_B (f_h - c u_h) - ||W||_0 ||f - f_h||_B / k
            + int (omega - c/k W) e.

Where the right side is above g, u does not touch g (supplement, Proposition S17).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.bounds.constraint import bernstein_bounds
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.fem.form import Form
from unilateral.fem.p1 import gradients
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import segment_distances
from unilateral.geometry.polygon import Polygon

RADIUS_RATIO = 4.0
"""Half discs have a radius of so many half lengths of their arc, or less if that does not fit."""
ARCS_PER_BLOCK = 16
"""Half discs of so many arcs are treated together: their numbers fit into a processor's cache."""
DISTANCE_SHARE = 1 - 1e-6
"""Of distances to other sides this part is used, for they are rounded."""
W_NORM = 0.1230
"""||W||_0 / rho is (319 / (6720 pi))^(1/2) = 0.12292.. (Proposition S17)."""


class ErrorBounds(NamedTuple):
    """Bounds on |||u - u_h|||, on ||u - u_h||_0, and on |||lambda - lambda_H|||_*."""

    energy: float
    value: float
    multiplier: float


@dataclass(frozen=True, eq=False)
class Arcs:
    """Parts of one side, arc k from `start` (k,) to `end` (k,), which are arc lengths of the boundary."""

    polygon: Polygon
    side: int
    start: Array
    end: Array

    def select(self, chosen: Index | Mask) -> Arcs:
        """Some of the arcs."""
        return replace(self, start=self.start[chosen], end=self.end[chosen])

    def halve(self) -> Arcs:
        """Both halves of each arc, in their order."""
        start = np.column_stack([self.start, self.middle]).ravel()
        return replace(self, start=start, end=np.column_stack([self.middle, self.end]).ravel())

    @property
    def middle(self) -> Array:
        """The arc lengths of the midpoints, (k,)."""
        return np.asarray(0.5 * (self.start + self.end))

    @property
    def half_length(self) -> Array:
        """Half of each length, (k,)."""
        return np.asarray(0.5 * (self.end - self.start))

    @property
    def centre(self) -> Array:
        """The midpoints, (k, 2)."""
        along = self.middle - self.polygon.starts[self.side]
        return np.asarray(
            self.polygon.vertices[self.side] + along[:, None] * self.polygon.tangents[self.side]
        )

    @cached_property
    def clearance(self) -> Array:
        """Numbers below the distances of all points of each arc from other sides; they may be negative."""
        starts = self.polygon.vertices
        nearest = np.empty(len(self.start))
        for block in row_blocks(len(nearest), ARCS_PER_BLOCK):
            distances = segment_distances(self.centre[block], starts, starts + self.polygon.edges)
            distances[:, self.side] = np.inf
            nearest[block] = distances.min(axis=1)
        return np.asarray(DISTANCE_SHARE * nearest - self.half_length)

    def find_intervals(self, points: Array) -> tuple[Index, Index]:
        """The first of the intervals between arc lengths that each arc meets, and the one after the last."""
        first = np.searchsorted(points, self.start, side="right") - 1
        return first, np.searchsorted(points, self.end, side="left")

    def to_axes(self, vectors: Array) -> Array:
        """Components (2, ...) of vectors (..., 2) along the side and into the domain."""
        x = vectors[..., 0]
        y = vectors[..., 1]
        axes = self.polygon.tangents[self.side], -self.polygon.normals[self.side]
        return np.stack([axis[0] * x + axis[1] * y for axis in axes])


def list_ranges(first: Index, end: Index) -> tuple[Index, Index]:
    """The numbers from `first` (k,) on and below `end` (k,), range after range, and the range of each."""
    counts = end - first
    owner = np.repeat(np.arange(len(first)), counts)
    return np.arange(len(owner)) + (first - np.cumsum(counts) + counts)[owner], owner


@dataclass(frozen=True, eq=False)
class HalfDiscs:
    """Half discs about the midpoints of d arcs, and the triangles near each, one half disc after another.

    They have the `radius` (d,). `triangle` (t,) are numbers in the mesh, near the half disc `disc` (t,).
    `place` (2, 3, t) are their nodes, along the side and into the domain from the midpoint. All triangles are
    there that meet the half disc about any point of the arc. `slopes` (2, t) is grad u_h, and `corners`
    (3, t) is u_h at the nodes.
    """

    arcs: Arcs
    radius: Array
    mesh: Mesh
    triangle: Index
    disc: Index
    place: Array
    corners: Array
    slopes: Array

    def add_up(self, values: Array) -> Array:
        """Sums (..., d) over the triangles of each half disc of `values` (..., t)."""
        return np.asarray(np.add.reduceat(values, self.first_triangle, axis=-1))

    def find_largest(self, values: Array) -> Array:
        """The largest of the `values` (t,) of each half disc's triangles, (d,)."""
        return np.asarray(np.maximum.reduceat(values, self.first_triangle))

    @cached_property
    def first_triangle(self) -> Index:
        """The place in `triangle` of the first one of each half disc, (d,)."""
        return np.searchsorted(self.disc, np.arange(len(self.radius)))

    def bound_means(self) -> tuple[Array, Array]:
        """Numbers below int omega u_h - slope (s - s_0) for all points s of each arc, and the slopes, (d,).

        omega is that about s, and s_0 is the midpoint.
        """
        area = self.mesh.areas[self.triangle]
        # l = level + slope . place is near u_h, and int omega l = level + slope_2 32 rho / (35 pi)
        whole_area = self.add_up(area)
        slope = self.add_up(self.slopes * area) / whole_area
        slope_x, slope_y = slope[:, self.disc]
        v = self.corners - (slope_x * self.place[0] + slope_y * self.place[1])
        level = self.add_up(v.mean(axis=0) * area) / whole_area
        v -= level[self.disc]
        moment = slope[1] * 32 * self.radius / (35 * math.pi)
        mean = level + moment + self.add_up(area * _product_means(self.omega, v))
        # for a point s at most half the length away the integral changes with the slope along the side
        change = self.arcs.half_length * self.find_largest(np.abs(self.slopes[0] - slope_x))
        size = np.abs(v).max(axis=0)
        lost = change + (self._interpolation_losses(size) + self._rounding_losses(size, np.abs(level)))
        return mean - self.mesh.exact_mesh_factor * lost, slope[0]

    @cached_property
    def peak(self) -> Array:
        """The largest values of omega, (d,)."""
        return np.asarray(6 / (math.pi * self.radius**2))

    @cached_property
    def omega(self) -> Array:
        """omega at the nodes, whose linear interpolant is first in its place, (3, t)."""
        t = (self.place[0] ** 2 + self.place[1] ** 2) / (self.radius**2)[self.disc]
        return np.asarray(self.peak[self.disc] * np.maximum(1 - t, 0) ** 2)

    @cached_property
    def centroid(self) -> Array:
        """The centroids of the triangles in the axes of `place`, (2, t)."""
        return np.asarray(self.place.mean(axis=1))

    @cached_property
    def distance(self) -> Array:
        """The distances of the centroids from the midpoint of the arc, (t,)."""
        return np.asarray(np.hypot(self.centroid[0], self.centroid[1]))

    @cached_property
    def circle(self) -> Array:
        """The radii of the circles about the centroids that contain the triangles, (t,)."""
        return np.asarray(self.mesh.enclosing_circles[1][self.triangle])

    def _bound_integrals(self, size: Array) -> Array:
        """Bounds (t,) on the integrals of |v| <= `size` (t,), 0 on triangles beside the half disc."""
        meets_disc = self.distance <= self.circle + self.radius[self.disc]
        return np.where(meets_disc, self.mesh.areas[self.triangle] * size, 0.0)

    def _interpolation_losses(self, size: Array) -> Array:
        """Bounds (d,) on |int (omega - I omega) v|, I omega linear on triangles, for |v| <= `size` (t,)."""
        # |D^2 omega| <= 4 max(1, 3 t - 1) peak / rho^2, and the mean of the error on a triangle is at most
        # that times an eighth of the squared distances of the nodes from the centroid (Proposition S17 (c))
        t = np.minimum((self.distance + self.circle) / self.radius[self.disc], 1.0) ** 2
        curvature = 4 * np.maximum(1, 3 * t - 1) * (self.peak / self.radius**2)[self.disc]
        spread = np.sum((self.place - self.centroid[:, None]) ** 2, axis=(0, 1)) / 8
        return self.add_up(self._bound_integrals(size) * (curvature * spread))

    def _rounding_losses(self, size: Array, level: Array) -> Array:
        """Bounds (d,) on what rounding and the exact mesh do to means, |v| <= `size` (t,), `level` (d,)."""
        mesh = self.mesh
        # areas, gradients and nodes of the exact mesh are others; |grad omega| < 2 peak / rho
        distortion = 3 * self.find_largest(mesh.distortion[self.triangle]) + SQUARES_ROUNDING
        shifts = mesh.node_shifts[mesh.triangles[self.triangle]].max(axis=1)
        place_rounding = self.find_largest(shifts) + 8 * EPS * mesh.polygon.largest
        gradient = self.find_largest(np.hypot(self.slopes[0], self.slopes[1]))
        mass = self.add_up(mesh.areas[self.triangle] * self.omega.mean(axis=0) * size)
        rounding = distortion * (mass + level + self.arcs.half_length * gradient)
        omega_change = 2 * self.peak / self.radius * self.add_up(self._bound_integrals(size))
        return np.asarray(rounding + place_rounding * (gradient + omega_change))


def select_along(mesh: Mesh, side: Arcs, max_edges: int) -> Index:
    """Triangles (t,) that half discs of arcs with up to `max_edges` edges of a whole side can meet."""
    (first,), (end,) = side.find_intervals(mesh.s)
    s = mesh.s[first : end + 1]
    longest = max(s[max_edges:] - s[:-max_edges], default=s[-1] - s[0])
    # no point of a triangle is nearer to the line of the side than a vertex
    height = (side.centre[0] - mesh.points) @ side.polygon.normals[side.side]
    is_near = height <= (RADIUS_RATIO + 1) * longest / 2
    return np.flatnonzero(np.logical_or.reduce([is_near.take(nodes) for nodes in mesh.triangles.T]))


@dataclass(frozen=True, eq=False)
class SuperMeans:
    """Lower bounds on u - g on arcs of a side, from means of u_h over half discs.

    The `layer` (t,) has the triangles near the `side`; `triangles` of arcs are numbers in it.
    """

    data: EnclosedData
    u_h: Array
    form: Form
    errors: ErrorBounds
    side: Arcs
    layer: Index

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh with the triangles of the layer only."""
        return self.data.mesh.select_triangles(self.layer)

    @cached_property
    def sequence(self) -> tuple[Index, Array]:
        """The triangles in their order along the side, and how far from its midpoint they lie there, (t,)."""
        places = self.side.to_axes(self.mesh.enclosing_circles[0] - self.side.centre)[0]
        order = np.argsort(places)
        return order, places[order]

    def select_near(self, arcs: Arcs) -> tuple[Index, Index]:
        """Triangles (t,) that half discs of the arcs can meet, arc after arc, and the arcs' numbers (t,)."""
        centroid, circle = self.mesh.enclosing_circles
        reach = (RADIUS_RATIO + 1) * arcs.half_length
        # first those that are near along the side, with the largest circle of all for their own ones
        order, places = self.sequence
        from_midpoint = arcs.middle - self.side.middle
        widest = reach + circle.max()
        first = np.searchsorted(places, from_midpoint - widest)
        number, arc = list_ranges(first, np.searchsorted(places, from_midpoint + widest))
        triangle = order[number]
        offsets = centroid[triangle] - arcs.centre[arc]
        is_near = np.hypot(offsets[:, 0], offsets[:, 1]) <= reach[arc] + circle[triangle]
        return triangle[is_near], arc[is_near]

    def bound_gaps(self, arcs: Arcs) -> Array:
        """Numbers below u - g everywhere on each of the arcs, -inf where no half disc fits, (k,)."""
        gaps = np.full(len(arcs.start), -math.inf)
        radius = np.minimum(RADIUS_RATIO * arcs.half_length, arcs.clearance)
        fitting = np.flatnonzero(radius > arcs.half_length)
        for block in row_blocks(len(fitting), ARCS_PER_BLOCK):
            chosen = arcs.select(fitting[block])
            discs = self.make_half_discs(chosen, radius[fitting[block]], *self.select_near(chosen))
            mean, slope = discs.bound_means()
            lost = self._bound_source_losses(discs) + self._bound_error_losses(discs.radius, chosen.clearance)
            gaps[fitting[block]] = mean - lost - self._bound_g(chosen, slope)
        return gaps

    def make_half_discs(self, arcs: Arcs, radius: Array, triangle: Index, disc: Index) -> HalfDiscs:
        """The half discs of the radii (d,) about the midpoints of arcs, with the triangles near each."""
        mesh = self.mesh
        nodes = mesh.triangles[triangle].T
        return HalfDiscs(
            arcs=arcs,
            radius=radius,
            mesh=mesh,
            triangle=triangle,
            disc=disc,
            place=arcs.to_axes(mesh.points.take(nodes, axis=0) - arcs.centre[disc]),
            corners=self.u_h[nodes],
            slopes=arcs.to_axes(self.gradient[triangle]),
        )

    @cached_property
    def gradient(self) -> Array:
        """grad u_h on the layer, (t, 2)."""
        return np.einsum("mid,mi->md", gradients(self.mesh), self.u_h[self.mesh.triangles])

    def _bound_source_losses(self, discs: HalfDiscs) -> Array:
        """Bounds on -1/k int (f - c u_h) W, (d,)."""
        source = self.data.source
        triangles = self.layer[discs.triangle]
        linear_part = source.f_h[triangles].T - self.form.c * discs.corners
        rest = source.oscillation[triangles] + source.jumps[triangles] + source.remainder[triangles]
        rest_norm = np.sqrt(discs.add_up(rest**2))
        rounding = SQUARES_ROUNDING * discs.find_largest(np.abs(linear_part).max(axis=0))
        # W >= 0, int W = rho^2 / 16; the least value is minus the largest of the opposite
        least = -discs.find_largest(-linear_part.min(axis=0))
        lost = discs.radius**2 / 16 * (rounding - least)
        return np.asarray(W_NORM * discs.radius * rest_norm + lost) / self.form.k

    def _bound_error_losses(self, radius: Array, R: Array) -> Array:
        """Bounds on |int (omega - c/k W) e|, where the half discs of the radii R lie in the domain, (d,)."""
        k = self.form.k
        # omega less 2 / (pi R^2) is the divergence of a radial field in the half disc of radius R; with
        # q = (rho / R)^2 the square of its norm is at most
        # (73/60 - ln q - 2 (1 - q) + (1 - q^2) / 2) / (2 pi)
        q = np.minimum((radius / R) ** 2, 1.0)
        field = np.sqrt((73 / 60 - np.log(q) - 2 * (1 - q) + (1 - q**2) / 2) / (2 * math.pi))
        value = math.sqrt(2 / math.pi) / R + self.form.c / k * W_NORM * radius
        lost = field / math.sqrt(k) * self.errors.energy + value * self.errors.value
        return np.asarray(lost * (1 + SQUARES_ROUNDING))

    def _bound_g(self, arcs: Arcs, slope: Array) -> Array:
        """Numbers above g - slope (s - s_0) on the arcs, (k,)."""
        constraint = self.data.constraint
        s = self.data.mesh.s
        # the intervals of the edges that an arc meets
        first_edge, last_edge = arcs.find_intervals(s)
        first = np.searchsorted(constraint.edge, first_edge)
        interval, arc = list_ranges(first, np.searchsorted(constraint.edge, last_edge))
        edge = constraint.edge[interval][:, None]
        places = s[edge] + constraint.x[interval] * (s[edge + 1] - s[edge])
        from_midpoint = places - arcs.middle[arc][:, None]
        highest = bernstein_bounds(constraint.p[interval] - slope[arc][:, None] * from_midpoint)[1]
        highest += constraint.remainder[interval]
        rounding = 8 * EPS * arcs.polygon.perimeter * np.abs(slope)
        return np.asarray(
            np.maximum.reduceat(highest, np.searchsorted(arc, np.arange(len(slope)))) + rounding
        )


def _product_means(first: Array, second: Array) -> Array:
    """Means (t,) over triangles of products of linear functions with these values (3, t) at the nodes."""
    return np.asarray((first.sum(axis=0) * second.sum(axis=0) + np.sum(first * second, axis=0)) / 12)
