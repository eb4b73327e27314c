"""Where the exact solution touches the obstacle and where it does not: what is proved, arc by arc.

u does not touch g on an arc where a mean of u over half discs is above g (`super_means`). For a tent w on an
arc, extended into its half disc,

    <lambda, w> >= <lambda_H, w> - |||lambda - lambda_H|||_* |||w|||,

and where this is positive, u = g somewhere in the arc (supplement, Proposition S20). Sides are halved until
u > g is proved, no contact is proved where lambda_H is positive throughout, or an arc is no longer than an
edge. As no half disc fits at a vertex, nothing is decided there.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.clamped_ends import LOWERING_PER_REMAINDER
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.local_bounds import Bound
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.super_means import Arc, ErrorBounds, SuperMeans, select_along
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
        whole = Arc(polygon, side, origin, float(polygon.starts[side + 1]))
        if side in idle_sides:
            parts = [(whole.start, whole.end, Verdict.FREE)]
        else:
            layer = select_along(data.mesh, whole, MAX_EDGES_PER_ARC)
            means = SuperMeans(data, u_h, form, errors, whole, layer)
            (parts,) = ContactProof(means, partition, lambda_H).decide([whole])
        certain += [CertainArc(side, start - origin, end - origin, verdict) for start, end, verdict in parts]
    return certain


@dataclass(frozen=True, eq=False)
class ContactProof:
    """What is proved of arcs by means of u_h and by forces of lambda_H on tents."""

    means: SuperMeans
    partition: Partition
    lambda_H: Array

    def decide(self, arcs: Sequence[Arc]) -> list[list[ProvedArc]]:
        """The parts of each of the arcs, in their order, with what is proved of them."""
        s = self.means.data.mesh.s
        edges = [arc.find_intervals(s) for arc in arcs]
        # where lambda_H is positive u_h is near g: there no gap can be proved, and else no contact
        in_contact = [self.lambda_H[arc.find_intervals(self.partition.points)] > 0 for arc in arcs]
        touches = [
            bool(positive.any()) and self.bound_tent(arc) > 0
            for arc, positive in zip(arcs, in_contact, strict=True)
        ]
        tried = [
            i
            for i, positive in enumerate(in_contact)
            if not positive.any() and edges[i].stop - edges[i].start <= MAX_EDGES_PER_ARC
        ]
        gaps = np.full(len(arcs), -math.inf)
        gaps[tried] = self.means.bound_gaps([arcs[i] for i in tried])

        parts: list[list[ProvedArc]] = []
        halved = []
        for i, arc in enumerate(arcs):
            shortest = np.diff(s[edges[i].start : edges[i].stop + 1]).min()
            is_short = arc.end - arc.start <= (1 + LENGTH_ROUNDING) * shortest
            verdict = Verdict.TOUCHES if touches[i] else Verdict.UNDECIDED
            if gaps[i] > 0:
                verdict = Verdict.FREE
            elif not is_short and (touches[i] or not in_contact[i].all()):
                halved.append(i)
            parts.append([(arc.start, arc.end, verdict)])

        # the halves of all arcs that are not decided, and what is proved of these
        halves = [half for i in halved for half in arcs[i].halve()]
        half_parts = self.decide(halves) if halves else []
        for i, first, second in zip(halved, half_parts[::2], half_parts[1::2], strict=True):
            parts[i] = _join_equal([*first, *second])
            open_parts = [k for k, part in enumerate(parts[i]) if part[2] is not Verdict.FREE]
            # there is contact in the arc, so in its only part that is not free
            if touches[i] and len(open_parts) == 1:
                start, end, _ = parts[i][open_parts[0]]
                parts[i][open_parts[0]] = (start, end, Verdict.TOUCHES)
        return parts

    def bound_tent(self, arc: Arc) -> float:
        """A lower bound on <lambda, w> for the tent w on the arc, 1 in the middle."""
        polygon = self.partition.polygon
        form = self.means.form
        radius = min(arc.half_length, arc.clearance + arc.half_length)
        # the antiderivative of 1 - |x| is x - x |x| / 2; the tent is 0 on cells that the arc does not meet
        cells = arc.find_intervals(self.partition.points)
        x = np.clip((self.partition.points[cells.start : cells.stop + 1] - arc.middle) / radius, -1, 1)
        weights = radius * np.diff(x - 0.5 * x * np.abs(x))
        lambda_H = self.lambda_H[cells]
        rounding = 8 * EPS * polygon.perimeter * (lambda_H @ (weights > 0))
        pairing = (1 - polygon.stretch.max() - SQUARES_ROUNDING) * (weights @ lambda_H - rounding)
        # |w|_1^2 = pi / 2 and ||w||_0^2 = pi rho^2 / 12 in the half disc
        norm = math.sqrt(form.k * math.pi / 2 + form.c * math.pi / 12 * radius**2)
        return float(pairing - (1 + SQUARES_ROUNDING) * self.means.errors.multiplier * norm)


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
