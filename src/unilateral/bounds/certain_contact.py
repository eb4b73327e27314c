"""Where the exact solution touches the obstacle and where it does not: what is proved, arc by arc.

u does not touch g on an arc where a mean of u over half discs is above g (`super_means`). For a tent w on an
arc, extended into its half disc,

    <lambda, w> >= <lambda_H, w> - |||lambda - lambda_H|||_* |||w|||,

and where this is positive, u = g somewhere in the arc (supplement, Proposition S17). Sides are halved until
u > g is proved, no contact is proved where lambda_H is positive throughout, or an arc is no longer than an
edge. As no half disc fits at a vertex, nothing is decided there.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.clamped_ends import LOWERING_PER_REMAINDER
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.local_bounds import Bound
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.super_means import Arcs, ErrorBounds, SuperMeans, list_ranges, select_along
from unilateral.fem.form import Form
from unilateral.formulas.taylor import EPS
from unilateral.geometry.partition import Partition

MAX_EDGES_PER_ARC = 8
"""An arc that meets more edges is halved before u > g is tried: larger half discs prove hardly more."""
LENGTH_ROUNDING = 1e-9
"""An arc is as long as an edge up to this."""


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


def find_certain_contact(
    data: EnclosedData,
    partition: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    bound: Bound,
    idle_sides: Collection[int] = (),
) -> list[CertainArc]:
    """Arcs that cover the sides with contact, in the order of the boundary, with what is proved of each.

    `bound` is the cheap one, or has smaller errors of another one. On `idle_sides` the data show that u > g.
    Adjacent arcs with the same verdict are joined unless they touch.
    """
    polygon = partition.polygon
    errors = ErrorBounds(bound.u, _bound_values(data, form, bound), bound.lambda_)
    certain = []
    for side in np.flatnonzero(form.has_multiplier(np.arange(polygon.n_sides))).tolist():
        origin = float(polygon.starts[side])
        end_of_side = float(polygon.starts[side + 1])
        if side in idle_sides:
            parts = [(origin, end_of_side, Verdict.FREE)]
        else:
            whole = Arcs(polygon, side, np.array([origin]), np.array([end_of_side]))
            layer = select_along(data.mesh, whole, MAX_EDGES_PER_ARC)
            means = SuperMeans(data, u_h, form, errors, whole, layer)
            (parts,) = ContactProof(means, partition, lambda_H).decide(whole)
        certain += [CertainArc(side, start - origin, end - origin, verdict) for start, end, verdict in parts]
    return certain


@dataclass(frozen=True, eq=False)
class ContactProof:
    """What is proved of arcs by means of u_h and by forces of lambda_H on tents."""

    means: SuperMeans
    partition: Partition
    lambda_H: Array

    def decide(self, arcs: Arcs) -> list[list[ProvedArc]]:
        """The parts of each of the arcs, in their order, with what is proved of them."""
        # where lambda_H is positive u_h is near g: there no gap can be proved, and else no contact
        meets_contact, lies_in_contact = self.find_discrete_contact(arcs)
        touches = meets_contact.copy()
        touches[touches] = self.bound_tents(arcs.select(touches)) > 0
        is_free = ~meets_contact & (self.count_edges(arcs) <= MAX_EDGES_PER_ARC)
        is_free[is_free] = self.means.bound_gaps(arcs.select(is_free)) > 0
        parts = _list_undivided(arcs, is_free, touches)

        # the halves of the arcs that are not decided and longer than an edge, and what is proved of these
        is_open = ~is_free & (touches | ~lies_in_contact)
        halved = np.flatnonzero(is_open & self.exceed_edges(arcs))
        half_parts = self.decide(arcs.select(halved).halve()) if halved.size else []
        for i, first, second in zip(halved, half_parts[::2], half_parts[1::2], strict=True):
            parts[i] = _join_halves([*first, *second], arc_touches=bool(touches[i]))
        return parts

    def find_discrete_contact(self, arcs: Arcs) -> tuple[Mask, Mask]:
        """Which arcs meet a cell with lambda_H > 0, and which meet no other cells, (k,) each."""
        first, end = arcs.find_intervals(self.partition.points)
        n_positive = np.append(0, np.cumsum(self.lambda_H > 0))
        n_in_contact = n_positive[end] - n_positive[first]
        return n_in_contact > 0, n_in_contact == end - first

    def count_edges(self, arcs: Arcs) -> Index:
        """The number of boundary edges that each arc meets, (k,)."""
        first, end = arcs.find_intervals(self.means.data.mesh.s)
        return end - first

    def exceed_edges(self, arcs: Arcs) -> Mask:
        """Which arcs are longer than the shortest of the boundary edges that they meet, (k,)."""
        s = self.means.data.mesh.s
        edges = np.column_stack(arcs.find_intervals(s)).ravel()
        shortest = np.minimum.reduceat(np.append(np.diff(s), np.inf), edges)[::2]
        return arcs.end - arcs.start > (1 + LENGTH_ROUNDING) * shortest

    def bound_tents(self, arcs: Arcs) -> Array:
        """Lower bounds on <lambda, w> for the tents w on the arcs, 1 in the middle, (k,).

        Where one is positive u = g somewhere in the arc (Proposition S17 (d)).
        """
        polygon = self.partition.polygon
        form = self.means.form
        radius = np.minimum(arcs.half_length, arcs.clearance + arcs.half_length)
        # a tent is 0 on the cells that its arc does not meet
        points = self.partition.points
        cell, arc = list_ranges(*arcs.find_intervals(points))
        # the antiderivative of 1 - |x| is x - x |x| / 2
        x = np.clip((points[[cell, cell + 1]] - arcs.middle[arc]) / radius[arc], -1, 1)
        weights = radius[arc] * np.diff(x - 0.5 * x * np.abs(x), axis=0)[0]
        lambda_H = self.lambda_H[cell]
        n = len(radius)
        rounding = 8 * EPS * polygon.perimeter * np.bincount(arc, lambda_H * (weights > 0), n)
        pairing = np.bincount(arc, weights * lambda_H, n) - rounding
        pairing *= 1 - polygon.stretch.max() - SQUARES_ROUNDING
        # |w|_1^2 = pi / 2 and ||w||_0^2 = pi rho^2 / 12 in the half disc
        norm = np.sqrt(form.k * math.pi / 2 + form.c * math.pi / 12 * radius**2)
        return np.asarray(pairing - (1 + SQUARES_ROUNDING) * self.means.errors.multiplier * norm)


def _list_undivided(arcs: Arcs, is_free: Mask, touches: Mask) -> list[list[ProvedArc]]:
    """The one part of each arc, with the verdict on it, before any is halved."""
    verdicts = np.where(is_free, Verdict.FREE, np.where(touches, Verdict.TOUCHES, Verdict.UNDECIDED))
    return [
        [(start, end, Verdict(verdict))]
        for start, end, verdict in zip(arcs.start.tolist(), arcs.end.tolist(), verdicts.tolist(), strict=True)
    ]


def _join_halves(half_parts: list[ProvedArc], arc_touches: bool) -> list[ProvedArc]:
    """The parts of an arc from those of its halves, in their order."""
    parts = _join_equal(half_parts)
    open_places = [k for k, (_, _, verdict) in enumerate(parts) if verdict is not Verdict.FREE]
    # u = g somewhere in the arc, so in its only part that is not free
    if arc_touches and len(open_places) == 1:
        start, end, _ = parts[open_places[0]]
        parts[open_places[0]] = (start, end, Verdict.TOUCHES)
    return parts


def _join_equal(parts: list[ProvedArc]) -> list[ProvedArc]:
    """The parts, adjacent ones joined where both are free or both are not decided."""
    joined = parts[:1]
    for start, end, verdict in parts[1:]:
        if verdict is joined[-1][2] is not Verdict.TOUCHES:
            joined[-1] = (joined[-1][0], end, verdict)
        else:
            joined.append((start, end, verdict))
    return joined


def _bound_values(data: EnclosedData, form: Form, bound: Bound) -> float:
    """A bound on ||u - u_h||_0: by c, or by Friedrichs' inequality for u - v with v = u_h + y."""
    value = bound.u / math.sqrt(form.c) if form.c else math.inf
    if form.clamped and form.friedrichs < math.inf:
        mesh = data.mesh
        outer = np.isin(mesh.triangles, mesh.boundary).any(axis=1)
        # |y| <= nodal values and bubbles, and hats for the remainder; what is on single edges vanishes on the
        # other edges of its triangle, so that its norm is at most the diameter times that of its gradient
        size = np.abs(bound.lift).max(axis=1).sum() + LOWERING_PER_REMAINDER * data.constraint.remainder.max()
        root_k = math.sqrt(form.k)
        y_norm = math.sqrt(mesh.areas[outer].sum()) * size + mesh.diameter * bound.lift_norm / root_k
        distance = form.friedrichs * bound.eta / root_k
        value = min(value, float(distance + mesh.exact_mesh_factor * y_norm))
    return value
