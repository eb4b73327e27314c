"""Where the exact solution touches the obstacle and where it does not: what is proved, arc by arc.

u does not touch g on an arc where a mean of u over half discs is above g (`super_means`). For a tent w on an
arc, extended into its half disc,

    <lambda, w> >= <lambda_H, w> - |||lambda - lambda_H|||_* |||w|||,

and where this is positive, u = g somewhere in the arc (supplement, Proposition S20). Sides are halved until
one of both is proved, or an arc has no node inside. As no half disc fits at a vertex, nothing is decided
there.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.clamped_ends import LOWERING_PER_REMAINDER
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.local_bounds import Bound
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.super_means import Arcs, ErrorBounds, SuperMeans
from unilateral.fem.form import Form
from unilateral.formulas.taylor import EPS
from unilateral.geometry.partition import Partition

MAX_EDGES_PER_ARC = 8
"""Longer arcs are halved before u > g is tried: a half disc with more triangles hardly proves more."""


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
    """A bound on ||u - u_h||_0: by c, or by Friedrichs' inequality for u - v with v = u_h + y."""
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
    """Lists of the parts of each arc, in their order, with what is proved of them."""
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
        """P, quadratic on cells."""
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
