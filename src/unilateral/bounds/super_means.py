"""Super-means: lower bounds on u - g on sides with contact, as u is not below its means over half discs.

Let x be a point of a side with contact, and B a half disc of radius rho about x that lies in the domain and
meets no other side. With t = r^2 / rho^2 the weight omega = 6 (1 - t)^2 / (pi rho^2) has the integral 1, and

    2 pi W = -ln t - 3 (1 - t) + 3 (1 - t^2) / 2 - (1 - t^3) / 3

is positive in B, vanishes on the circle with its gradient, and -Laplace W is the unit mass at x less omega.
So u(x) is int omega u + (int (f - c u) W + <lambda, W>) / k. With lambda >= 0, int W = rho^2 / 16, and
e = u - u_h it follows that

    u(x) >= int omega u_h + rho^2 / (16 k) min_B (f_h - c u_h) - ||W||_0 ||f - f_h||_B / k
            + int (omega - c/k W) e.

Where the right side is above g, u does not touch g (supplement, Proposition S20).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.constraint import bernstein_bounds
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.fem.form import Form
from unilateral.fem.p1 import gradients
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross, segment_distances
from unilateral.geometry.polygon import Polygon

if TYPE_CHECKING:
    from scipy.spatial import KDTree

RADII_PER_ARC = (4.0, 2.0)
"""Half discs have a radius of so many half lengths of their arc, or less if that does not fit."""
ARCS_PER_BLOCK = 256
N_SECTORS = 32
"""The half plane above a side is cut into so many sectors, in which distances of other sides are known."""
MIN_ANGLE = 1e-6
"""A side that is seen under a smaller angle than this counts by its least distance in all its sectors."""
ANGLE_ROUNDING = 1e-9
"""Angles are computed up to this."""
FIT_SHARE = 0.01
"""Triangles without a node in the half disc have this weight, per area and peak, where u_h is fitted."""
DISTANCE_SHARE = 1 - 1e-6
"""Of distances to other sides this part is used, for they are rounded."""
W_NORM = 0.1230
"""||W||_0 / rho is (319 / (6720 pi))^(1/2) = 0.12292.. (Proposition S20)."""


class ErrorBounds(NamedTuple):
    """Bounds on |||u - u_h|||, on ||u - u_h||_0, and on |||lambda - lambda_H|||_*."""

    energy: float
    value: float
    multiplier: float


class Arcs(NamedTuple):
    """Arcs (a,) of sides, between two arc lengths of the boundary."""

    polygon: Polygon
    side: Index
    start: Array
    end: Array

    def select(self, chosen: Mask | Index) -> Arcs:
        """Some of the arcs."""
        return Arcs(self.polygon, self.side[chosen], self.start[chosen], self.end[chosen])

    def halve(self) -> Arcs:
        """Both halves of each arc, one after the other."""
        start = np.stack([self.start, self.middle], axis=1).ravel()
        end = np.stack([self.middle, self.end], axis=1).ravel()
        return Arcs(self.polygon, np.repeat(self.side, 2), start, end)

    @property
    def middle(self) -> Array:
        """The arc lengths of the midpoints, (a,)."""
        return 0.5 * (self.start + self.end)

    @property
    def half_length(self) -> Array:
        """Half the lengths, (a,)."""
        return 0.5 * (self.end - self.start)

    @property
    def centre(self) -> Array:
        """The midpoints, (a, 2)."""
        along = self.middle - self.polygon.starts[self.side]
        return np.asarray(
            self.polygon.vertices[self.side] + along[:, None] * self.polygon.tangents[self.side]
        )

    def to_axes(self, vectors: Array, arc: Index) -> Array:
        """Components (2, ..., k) of vectors (..., k, 2) along the side of an arc (k,) and into the domain."""
        side = self.side[arc]
        axes = np.stack([self.polygon.tangents[side], -self.polygon.normals[side]])
        return np.einsum("fkd,...kd->f...k", axes, vectors)

    def distance(self) -> Array:
        """The distances of the midpoints from other sides, (a, sides), and infinity from their own."""
        vertices = self.polygon.vertices
        distances = segment_distances(self.centre, vertices, np.roll(vertices, -1, axis=0))
        distances[np.arange(len(distances)), self.side] = np.inf
        return np.asarray(DISTANCE_SHARE * distances)

    def distance_in_sectors(self) -> Array:
        """Distances (a, n) below those of other sides from any point of an arc, in n sectors about it."""
        least = self.distance()
        arc = np.arange(len(least))
        # a + x e are the sides, by their distances along the arc and into the domain
        a = self.to_axes(self.polygon.vertices[:, None] - self.centre, arc).T[:, None]
        e = self.to_axes(np.repeat(self.polygon.edges[:, None], len(arc), axis=1), arc).T[:, None]
        # the angles with the inward normal under which a side is seen
        start_angle = np.arctan2(a[..., 0], a[..., 1])
        angles = np.sort(np.stack([start_angle, np.roll(start_angle, -1, axis=2)]), axis=0)
        rays = np.linspace(-0.5 * math.pi, 0.5 * math.pi, N_SECTORS + 1)[:, None]
        low = np.maximum(rays[:-1], angles[0] - ANGLE_ROUNDING)
        high = np.minimum(rays[1:], angles[1] + ANGLE_ROUNDING)
        # on the ray u its distance is (a x e) / (u x e), and between two rays at least the cosine times that
        distances = [_ray_distances(a, e, angle) for angle in (low, high)]
        distance = np.maximum(math.cos(math.pi / N_SECTORS) * np.minimum(*distances), least[:, None])
        # sides that are hardly seen, or pass behind the midpoint, count by their least distance
        seen = angles[1] - angles[0]
        distance = np.where((seen < MIN_ANGLE) | (seen > math.pi), least[:, None], distance)
        nearest = DISTANCE_SHARE * np.where(low <= high, distance, np.inf).min(axis=2)

        # from another point of the arc a place is seen in another sector, by at most this many
        shifts = np.ceil(np.arcsin(self.half_length / least.min(axis=1)) * N_SECTORS / math.pi)
        widened = nearest.copy()
        for shift in range(1, int(shifts.max()) + 1):
            for offset in (-shift, shift):
                beside = np.roll(nearest, offset, axis=1)
                beside[:, : max(offset, 0)] = np.inf
                beside[:, N_SECTORS + min(offset, 0) :] = np.inf
                widened = np.where((shifts >= shift)[:, None], np.minimum(widened, beside), widened)
        return np.asarray(widened - self.half_length[:, None])


@dataclass(frozen=True, eq=False)
class HalfDiscs:
    """Half discs of these radii (a,) about the midpoints of arcs, and the triangles near them as pairs (p,).

    `place` (2, 3, p) are the nodes of a pair's triangle, along the side and into the domain from the midpoint
    of its `arc` (p,). All triangles are there that meet the half disc about any point of the arc.
    `slopes` (2, p) is grad u_h, and `corners` (3, p) is u_h at the nodes.
    """

    arcs: Arcs
    radius: Array
    mesh: Mesh
    arc: Index
    triangle: Index
    place: Array
    corners: Array
    slopes: Array

    def sum(self, values: Array) -> Array:
        """The sums over the triangles of each arc, (a,)."""
        return np.bincount(self.arc, values, len(self.radius)).astype(float)

    def max(self, values: Array) -> Array:
        """The largest of the values at the triangles of each arc, (a,)."""
        largest = np.full(len(self.radius), -np.inf)
        np.maximum.at(largest, self.arc, values)
        return largest

    def means(self) -> tuple[Array, Array]:
        """Numbers below int omega u_h - slope (s - s_0) for all points s of each arc, and the slopes, (a,).

        omega is that about s, and s_0 is the midpoint.
        """
        # l = level + slope . place is near u_h, and int omega l = level + slope_2 32 rho / (35 pi)
        share = self.mass + FIT_SHARE * self.peak[self.arc] * self.area
        total = self.sum(share)
        slope = np.stack([self.sum(share * component) / total for component in self.slopes])
        v = self.corners - np.einsum("fp,fip->ip", slope[:, self.arc], self.place)
        level = self.sum(share * v.mean(axis=0)) / total
        v = v - level[self.arc]
        mean = level + slope[1] * 32 * self.radius / (35 * math.pi)
        mean += self.sum(self.area * _product_means(self.omega, v))
        # for a point s at most half the length away the integral changes with the slope along the side
        change = self.arcs.half_length * self.max(np.abs(self.slopes[0] - slope[0, self.arc]))
        lost = change + self._interpolation_loss(np.abs(v).max(axis=0), np.abs(level))
        return mean - self.mesh.exact_mesh_factor * lost, slope[0]

    @cached_property
    def area(self) -> Array:
        """The areas of the triangles, (p,)."""
        return np.asarray(self.mesh.areas[self.triangle])

    @cached_property
    def peak(self) -> Array:
        """The largest value of omega, (a,)."""
        return np.asarray(6 / (math.pi * self.radius**2))

    @cached_property
    def omega(self) -> Array:
        """omega at the nodes, whose linear interpolant is first in its place, (3, p)."""
        t = np.sum(self.place**2, axis=0) / self.radius[self.arc] ** 2
        return np.asarray(self.peak[self.arc] * np.maximum(1 - t, 0) ** 2)

    @cached_property
    def mass(self) -> Array:
        """The integrals of that interpolant, (p,)."""
        return np.asarray(self.area * self.omega.mean(axis=0))

    def _interpolation_loss(self, size: Array, level: Array) -> Array:
        """Bounds (a,) on what the means lack by interpolation and rounding, with |v| <= `size` (p,)."""
        mesh = self.mesh
        radius = self.radius[self.arc]
        centroid = self.place.mean(axis=1)
        distance = np.hypot(*centroid)
        circle = mesh.enclosing_circles[1][self.triangle]
        inside = distance <= circle + radius
        # |D^2 omega| <= 4 max(1, 3 t - 1) peak / rho^2, and the mean of the error on a triangle is at most
        # that times an eighth of the squared distances of the nodes from the centroid (Proposition S20)
        t = np.minimum((distance + circle) / radius, 1.0) ** 2
        curvature = 4 * np.maximum(1, 3 * t - 1) * self.peak[self.arc] / radius**2
        spread = np.sum((self.place - centroid[:, None]) ** 2, axis=(0, 1)) / 8
        weighted = inside * self.area * size
        # areas, gradients and nodes of the exact mesh are others; |grad omega| < 2 peak / rho
        distortion = 3 * float(mesh.distortion.max()) + SQUARES_ROUNDING
        gradient = self.max(np.hypot(*self.slopes))
        place_rounding = float(mesh.node_shifts.max()) + 8 * EPS * mesh.polygon.largest
        rounding = distortion * (self.sum(self.mass * size) + level + self.arcs.half_length * gradient)
        rounding += place_rounding * (gradient + 2 * self.peak / self.radius * self.sum(weighted))
        return self.sum(weighted * curvature * spread) + rounding


@dataclass(frozen=True, eq=False)
class SuperMeans:
    """Lower bounds on u - g on arcs, from means of u_h over half discs."""

    data: EnclosedData
    u_h: Array
    form: Form
    errors: ErrorBounds

    @cached_property
    def trees(self) -> list[tuple[Index, float, KDTree]]:
        """Triangles of about one size, the largest radius of a circle that contains one, and centroids."""
        from scipy.spatial import KDTree  # which a solution needs only where its contact is asked for

        centroid, radius = self.data.mesh.enclosing_circles
        binary_size = np.frexp(radius)[1]
        classes = [np.flatnonzero(binary_size == size) for size in np.unique(binary_size)]
        return [
            (
                members,
                float(radius[members].max()),
                KDTree(centroid[members], compact_nodes=False, balanced_tree=False),
            )
            for members in classes
        ]

    def bound_gap(self, arcs: Arcs) -> Array:
        """Numbers below u - g everywhere on each arc, (a,), -inf where no half disc fits."""
        half = arcs.half_length
        room = arcs.distance().min(axis=1) - half
        gap = np.full(len(half), -np.inf)
        for ratio in RADII_PER_ARC:
            radius = np.minimum(ratio * half, room)
            chosen = np.flatnonzero(radius > half)
            for first in range(0, len(chosen), ARCS_PER_BLOCK):
                block = chosen[first : first + ARCS_PER_BLOCK]
                discs = self._find_triangles(arcs.select(block), radius[block])
                mean, slope = discs.means()
                lost = self._source_loss(discs) + self._error_loss(discs) + self._highest_g(discs.arcs, slope)
                gap[block] = np.fmax(gap[block], mean - lost)
        return gap

    def _find_triangles(self, arcs: Arcs, radius: Array) -> HalfDiscs:
        """The half discs of these radii with their triangles."""
        mesh = self.data.mesh
        centre = arcs.centre
        reach = radius + arcs.half_length
        pair_arcs = []
        pair_triangles = []
        for members, largest, tree in self.trees:
            near = tree.query_ball_point(centre, reach + largest)
            pair_arcs.append(np.repeat(np.arange(len(near)), [len(numbers) for numbers in near]))
            pair_triangles.append(members[np.concatenate([*near, []]).astype(int)])
        arc = np.concatenate(pair_arcs)
        triangle = np.concatenate(pair_triangles)
        centroid, circle = mesh.enclosing_circles
        meets = np.hypot(*(centroid[triangle] - centre[arc]).T) <= reach[arc] + circle[triangle]
        arc = arc[meets]
        triangle = triangle[meets]
        nodes = mesh.triangles[triangle].T
        corners = self.u_h[nodes]
        gradient = np.einsum("pid,ip->pd", gradients(mesh.select_triangles(triangle)), corners)
        return HalfDiscs(
            arcs=arcs,
            radius=radius,
            mesh=mesh,
            arc=arc,
            triangle=triangle,
            place=arcs.to_axes(mesh.points[nodes] - centre[arc], arc),
            corners=corners,
            slopes=arcs.to_axes(gradient, arc),
        )

    def _source_loss(self, discs: HalfDiscs) -> Array:
        """Bounds on -1/k int (f - c u_h) W, (a,)."""
        source = self.data.source
        linear_part = source.f_h[discs.triangle].T - self.form.c * discs.corners
        least = -discs.max(-linear_part.min(axis=0))
        rest = source.oscillation[discs.triangle] + source.jumps[discs.triangle]
        rest_norm = np.sqrt(discs.sum((rest + source.remainder[discs.triangle]) ** 2))
        rounding = SQUARES_ROUNDING * discs.max(np.abs(linear_part).max(axis=0))
        # W >= 0, int W = rho^2 / 16
        return (W_NORM * discs.radius * rest_norm + discs.radius**2 / 16 * (rounding - least)) / self.form.k

    def _error_loss(self, discs: HalfDiscs) -> Array:
        """Bounds on |int (omega - c/k W) e|, (a,)."""
        k = self.form.k
        c = self.form.c
        # omega less 2 / (pi R^2) in the sector of radius R is the divergence of a radial field sigma; with
        # q = (rho / R)^2 the square of its norm is the mean over the sectors of at most
        # (73/60 - ln q - 2 (1 - q) + (1 - q^2) / 2) / (2 pi)
        R = discs.arcs.distance_in_sectors()
        q = np.minimum((discs.radius[:, None] / R) ** 2, 1.0)
        sigma_squares = (73 / 60 - np.log(q) - 2 * (1 - q) + (1 - q**2) / 2) / (2 * math.pi)
        sigma = np.sqrt(sigma_squares.mean(axis=1))
        rest = np.sqrt(2 / math.pi * np.mean(R**-2, axis=1))
        loss = sigma * self.errors.energy / math.sqrt(k) + rest * self.errors.value
        if c:
            # |||e|||^2 = k |e|_1^2 + c ||e||_0^2 bounds both terms together, too
            loss = np.minimum(loss, np.hypot(sigma / math.sqrt(k), rest / math.sqrt(c)) * self.errors.energy)
        return np.asarray(loss + c / k * W_NORM * discs.radius * self.errors.value) * (1 + SQUARES_ROUNDING)

    def _highest_g(self, arcs: Arcs, slope: Array) -> Array:
        """Numbers above g - slope (s - s_0) on the arcs, (a,)."""
        constraint = self.data.constraint
        s = self.data.mesh.s
        first_edge = np.searchsorted(s, arcs.start, side="right") - 1
        end_edge = np.searchsorted(s, arcs.end, side="left")
        order = np.argsort(constraint.edge, kind="stable")
        first, end = np.searchsorted(constraint.edge[order], [first_edge, end_edge])
        # all intervals of all edges that meet the arcs, one after the other
        counts = end - first
        arc = np.repeat(np.arange(len(slope)), counts)
        interval = order[np.arange(len(arc)) + np.repeat(first - (np.cumsum(counts) - counts), counts)]
        edge = constraint.edge[interval][:, None]
        places = s[edge] + constraint.x[interval] * np.diff(s)[edge]
        p = constraint.p[interval] - slope[arc, None] * (places - arcs.middle[arc, None])
        rounding = 8 * EPS * arcs.polygon.perimeter * np.abs(slope[arc])
        highest = np.full(len(slope), -np.inf)
        np.maximum.at(highest, arc, bernstein_bounds(p)[1] + constraint.remainder[interval] + rounding)
        return highest


def _product_means(first: Array, second: Array) -> Array:
    """Means (p,) over triangles of products of linear functions with these values (3, p) at the nodes."""
    return np.asarray((first.sum(axis=0) * second.sum(axis=0) + np.sum(first * second, axis=0)) / 12)


def _ray_distances(a: Array, e: Array, angle: Array) -> Array:
    """Distances of lines a + x e along rays at these angles with the second axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.abs(cross(a, e) / cross(np.stack([np.sin(angle), np.cos(angle)], axis=-1), e))
