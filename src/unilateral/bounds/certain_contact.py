"""Where the exact solution touches the obstacle and where it does not: what is proved, arc by arc.

Let x be a point of a side with contact, and B a half disc of radius rho about x that lies in the domain and
meets no other side. With t = r^2 / rho^2 the weight omega = 6 (1 - t)^2 / (pi rho^2) has the integral 1, and

    2 pi W = -ln t - 3 (1 - t) + 3 (1 - t^2) / 2 - (1 - t^3) / 3

is positive in B, vanishes on the circle with its gradient, and -Laplace W is the unit mass at x less omega.
So u(x) is int omega u + (int (f - c u) W + <lambda, W>) / k. With lambda >= 0, int W = rho^2 / 16, and
e = u - u_h it follows that

    u(x) >= int omega u_h + rho^2 / (16 k) min_B (f_h - c u_h) - ||W||_0 ||f - f_h||_B / k
            + int (omega - c/k W) e.

Where this is above g, u does not touch g. For a tent w on an arc, extended into its half disc,

    <lambda, w> >= <lambda_H, w> - |||lambda - lambda_H|||_* |||w|||,

and where this is positive, u = g somewhere in the arc (supplement, Proposition S20). Sides are halved until
one of both is proved, or an arc has no node inside. No half disc fits at a vertex, so nothing is decided there.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.clamped_ends import LOWERING_PER_REMAINDER
from unilateral.bounds.constraint import bernstein_bounds
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.local_bounds import Bound
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.fem.form import Form
from unilateral.fem.p1 import gradients
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.plane import cross, segment_distances
from unilateral.geometry.polygon import Polygon

MAX_EDGES_PER_ARC = 8
"""Longer arcs are halved before u > g is tried: a half disc with more triangles hardly proves more."""
RADII_PER_ARC = (4.0, 2.0)
"""Half discs have a radius of so many half lengths of their arc, or less if that does not fit."""
ARCS_PER_BLOCK = 256
N_SECTORS = 32
"""The half plane above a side is cut into so many sectors, in which distances of other sides are known."""
MIN_ANGLE = 1e-6
"""A side that is seen under a smaller angle than this counts by its least distance in all its sectors."""
ANGLE_ROUNDING = 1e-9
"""Angles are computed up to this."""
MIN_MASS = 1e-300
"""Where omega is 0 at all nodes, sums are divided by this."""
DISTANCE_SHARE = 1 - 1e-6
"""Of distances to other sides this part is used, for they are rounded."""
W_NORM = 0.1230
"""||W||_0 / rho is (319 / (6720 pi))^(1/2) = 0.12292.. (Proposition S20)."""


class Verdict(StrEnum):
    """What is proved of an arc: u = g somewhere in it, u > g everywhere in it, or neither."""

    TOUCHES = "touches"
    FREE = "does not touch"
    UNDECIDED = "not decided"


class CertainArc(NamedTuple):
    """What is proved of a part of a side, between two arc lengths from the side's own start."""

    side: int
    start: float
    end: float
    verdict: Verdict


ProvedArc = tuple[float, float, Verdict]
"""A part of an arc, between two arc lengths of the boundary."""


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
    of its `arc` (p,). All triangles are there that meet the half disc about any point of the arc. `slopes` (2,
    p) is grad u_h, and `corners` (3, p) is u_h at the nodes.
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
        mesh = self.mesh
        area = mesh.areas[self.triangle]
        radius = self.radius
        # omega at the nodes; its interpolant is in its place first
        t = np.sum(self.place**2, axis=0) / radius[self.arc] ** 2
        peak = 6 / (math.pi * radius**2)
        omega = peak[self.arc] * np.maximum(1 - t, 0) ** 2
        mass = area * omega.mean(axis=0)
        total = np.maximum(self.sum(mass), MIN_MASS)
        # l = level + slope . place is near u_h, and int omega l = level + slope_2 32 rho / (35 pi)
        slope = np.stack([self.sum(mass * component) / total for component in self.slopes])
        v = self.corners - np.einsum("fp,fip->ip", slope[:, self.arc], self.place)
        level = self.sum(area * _product_means(omega, v)) / total
        v = v - level[self.arc]
        mean = level + slope[1] * 32 * radius / (35 * math.pi) + self.sum(area * _product_means(omega, v))

        # omega less its interpolant, by the second derivatives of omega (Proposition S20)
        size = np.abs(v).max(axis=0)
        centroid = self.place.mean(axis=1)
        spread = np.sum((self.place - centroid[:, None]) ** 2, axis=(0, 1)) / 8
        distance = np.hypot(*centroid)
        circle = mesh.enclosing_circles[1][self.triangle]
        inside = distance <= circle + radius[self.arc]
        outermost = np.minimum((distance + circle) / radius[self.arc], 1.0) ** 2
        curvature = inside * 4 * np.maximum(1, 3 * outermost - 1) * (peak / radius**2)[self.arc]
        lost = self.sum(area * curvature * spread * size)
        # for a point s at most half the length away the integral changes with the slope along the side
        lost += self.arcs.half_length * self.max(np.abs(self.slopes[0] - slope[0, self.arc]))
        # areas and nodes of the exact mesh are others; |grad omega| < 2 peak / rho
        lost += (3 * mesh.distortion.max() + SQUARES_ROUNDING) * (self.sum(mass * size) + np.abs(level))
        gradient = self.max(np.hypot(*self.slopes))
        lost += 2 * mesh.distortion.max() * self.arcs.half_length * gradient
        steepness = gradient + 2 * peak / radius * self.sum(inside * area * size)
        place_rounding = float(mesh.node_shifts.max()) + 8 * EPS * mesh.polygon.largest
        return mean - mesh.exact_mesh_factor * (lost + place_rounding * steepness), slope[0]


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


def find_certain_contact(
    data: EnclosedData,
    partition: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    bound: Bound,
    idle_sides: Collection[int] = (),
) -> list[CertainArc]:
    """What is proved of the sides with contact, in the order of the boundary, which the arcs cover once.

    `bound` is the cheap one, or has smaller errors of another one. On `idle_sides` the data show that u > g.
    Adjacent arcs with the same verdict are joined unless they touch.
    """
    polygon = partition.polygon
    sides = np.flatnonzero(form.has_multiplier(np.arange(polygon.n_sides)))
    errors = ErrorBounds(bound.u, _bound_values(data, form, bound), bound.lambda_)
    means = SuperMeans(data, u_h, form, errors)
    whole = Arcs(polygon, sides, polygon.starts[sides], polygon.starts[sides + 1])
    tried = ~np.isin(sides, [*idle_sides])
    proofs = iter(_decide(whole.select(tried), means, partition, lambda_H))
    certain = []
    for side, is_tried in zip(sides.tolist(), tried.tolist(), strict=True):
        free_side = [(polygon.starts[side], polygon.starts[side + 1], Verdict.FREE)]
        for start, end, verdict in _join_equal(next(proofs) if is_tried else free_side):
            first = start - polygon.starts[side]
            certain.append(CertainArc(side, float(first), float(end - polygon.starts[side]), verdict))
    return certain


def _bound_values(data: EnclosedData, form: Form, bound: Bound) -> float:
    """A bound on ||u - u_h||_0: by c, or by Friedrichs' inequality for u - v with the feasible v = u_h + y."""
    value = bound.u / math.sqrt(form.c) if form.c else math.inf
    if form.clamped and form.friedrichs < math.inf:
        mesh = data.mesh
        outer = np.isin(mesh.triangles, mesh.boundary).any(axis=1)
        # |y| <= nodal values and bubbles, and hats for the remainder; what is on single edges vanishes on the
        # other edges of its triangle, so that its norm is at most the diameter times that of its gradient
        size = np.abs(bound.lift).max(axis=1).sum() + LOWERING_PER_REMAINDER * data.constraint.remainder.max()
        y_norm = math.sqrt(mesh.areas[outer].sum()) * size + mesh.diameter * bound.lift_norm / math.sqrt(
            form.k
        )
        distance = form.friedrichs * bound.eta / math.sqrt(form.k)
        value = min(value, float(distance + mesh.exact_mesh_factor * y_norm))
    return value


def _decide(arcs: Arcs, means: SuperMeans, partition: Partition, lambda_H: Array) -> list[list[ProvedArc]]:
    """What is proved of each arc, as a list of its parts in their order."""
    if not len(arcs.side):
        return []
    s = means.data.mesh.s
    tents = _bound_tents(arcs, partition, lambda_H, means.form, means.errors.multiplier)
    n_nodes = np.searchsorted(s, arcs.end, side="left") - np.searchsorted(s, arcs.start, side="right")
    # where there is contact u > g cannot be proved
    tried = np.flatnonzero((tents <= 0) & (n_nodes < MAX_EDGES_PER_ARC))
    is_free = np.zeros(len(tents), dtype=bool)
    is_free[tried] = means.bound_gap(arcs.select(tried)) > 0
    is_halved = ~is_free & (n_nodes > 0)
    halves = iter(_decide(arcs.select(is_halved).halve(), means, partition, lambda_H))
    proofs = []
    for i, (start, end) in enumerate(zip(arcs.start.tolist(), arcs.end.tolist(), strict=True)):
        if is_halved[i]:
            proof = _join_equal([*next(halves), *next(halves)])
            open_arcs = [k for k, part in enumerate(proof) if part[2] is not Verdict.FREE]
            # there is contact in the arc, so in its only part that is not free
            if tents[i] > 0 and len(open_arcs) == 1:
                proof[open_arcs[0]] = (*proof[open_arcs[0]][:2], Verdict.TOUCHES)
        else:
            verdict = Verdict.TOUCHES if tents[i] > 0 else Verdict.UNDECIDED
            proof = [(start, end, Verdict.FREE if is_free[i] else verdict)]
        proofs.append(proof)
    return proofs


def _join_equal(parts: list[ProvedArc]) -> list[ProvedArc]:
    """The parts, adjacent ones joined where both are free or both are not decided."""
    joined = parts[:1]
    for start, end, verdict in parts[1:]:
        if verdict is joined[-1][2] is not Verdict.TOUCHES:
            joined[-1] = (joined[-1][0], end, verdict)
        else:
            joined.append((start, end, verdict))
    return joined


def _bound_tents(
    arcs: Arcs, partition: Partition, lambda_H: Array, form: Form, multiplier_bound: float
) -> Array:
    """Lower bounds on <lambda, w> for tents w on the arcs, 1 in the middle, (a,)."""
    radius = np.minimum(arcs.half_length, arcs.distance().min(axis=1))
    # with P'' = lambda_H, <lambda_H, w> is a second difference of P, over the radius
    lengths = partition.lengths
    P_slope = np.append(0, np.cumsum(lengths * lambda_H))
    P = np.append(0, np.cumsum(lengths * (P_slope[:-1] + 0.5 * lengths * lambda_H)))

    def evaluate_P(s: Array) -> Array:
        cell = np.clip(np.searchsorted(partition.points, s, side="right") - 1, 0, len(lengths) - 1)
        x = s - partition.points[cell]
        return np.asarray(P[cell] + x * (P_slope[cell] + 0.5 * x * lambda_H[cell]))

    middle = arcs.middle
    difference = evaluate_P(middle - radius) - 2 * evaluate_P(middle) + evaluate_P(middle + radius)
    rounding = 8 * len(P) * EPS * P[-1]
    pairing = (1 - arcs.polygon.stretch.max()) * (difference - rounding) / radius
    # |w|_1^2 = pi / 2 and ||w||_0^2 = pi rho^2 / 12 in the half disc
    norm = np.sqrt(form.k * math.pi / 2 + form.c * math.pi / 12 * radius**2)
    return np.asarray(pairing - (1 + SQUARES_ROUNDING) * multiplier_bound * norm)


def _product_means(first: Array, second: Array) -> Array:
    """The means over triangles of products of linear functions with these values (3, p) at the nodes, (p,)."""
    return np.asarray((first.sum(axis=0) * second.sum(axis=0) + np.sum(first * second, axis=0)) / 12)


def _ray_distances(a: Array, e: Array, angle: Array) -> Array:
    """Distances of lines a + x e along rays at these angles with the second axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.abs(cross(a, e) / cross(np.stack([np.sin(angle), np.cos(angle)], axis=-1), e))
