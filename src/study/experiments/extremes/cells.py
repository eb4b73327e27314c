"""Axes of T_H beside the mesh: h/H, cells just off the edges, short cells, kernels of S."""

from __future__ import annotations

import numpy as np

from study.experiments.extremes.outcome import (
    NOTHING,
    Axis,
    Budget,
    Start,
    attempts,
    by_law,
    condition,
    predicted,
    within,
)
from study.experiments.extremes.problem import (
    ExtremeProblem,
    full,
    on_square,
    posed,
    structured_square,
    waves,
)
from study.experiments.extremes.shapes import SLACK
from unilateral.arrays import Array
from unilateral.geometry import mesh as meshes
from unilateral.geometry.partition import Partition, from_points, shifted, uniform
from unilateral.geometry.polygon import square


def ratio(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The axis is h/H on structured meshes, below 1/2 at the given H, else at the given h.

    S is singular from 1 on.
    """

    def problem(value: float) -> ExtremeProblem:
        edge, cell = (H * value, H) if value < 0.5 else (h, h / value)
        return on_square(edge, cell, waves)

    rows = attempts(values, problem, budget, condition)
    return Axis(predicted(rows, np.where(values >= 1, np.inf, np.nan)), 1.0)


def odd(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h and an odd number e of edges: beta is like 1/e, so that cond(S) ~ 1/(H beta^2) is like e^3."""

    def problem(edges: float) -> ExtremeProblem:
        counts = np.full(4, int(edges) // 4)
        counts[3] += int(edges) - counts.sum()
        points = square().divided(counts)
        return posed(meshes.with_boundary(square(), points[:-1]), Partition(square(), points), waves)

    rows = attempts(values, problem, budget, condition)
    return by_law(rows, values, (values / values[0]) ** 3, budget)


def shift(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h, and points of T_H inside sides are moved by that fraction of a cell: cond(S) ~ fraction^-2."""
    mesh = structured_square(h)

    def problem(fraction: float) -> ExtremeProblem:
        return posed(mesh, shifted(square(), h, fraction), waves)

    rows = attempts(values, problem, budget, condition)
    return by_law(rows, values, (values[0] / values) ** 2, budget)


def short(values: Array, h: float, H: float, budget: Budget, start: Start = 0.0) -> Axis:
    """One cell at a mesh vertex has that length, in units of a side: lambda_min(S) is like that length."""
    mesh, points = structured_square(h), uniform(square(), H).points

    def problem(length: float) -> ExtremeProblem:
        return posed(mesh, from_points(square(), np.sort(np.append(points, 0.5 + length))), waves)

    rows = attempts(values, problem, budget, condition, start)
    return by_law(rows, values, values[0] / values, budget)


def short_loaded(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """One short cell as in `short`, and lambda^0 = 1/length on that cell and 0 on all others."""

    def start(length: float, of: ExtremeProblem) -> Array:
        H_i = of.spaces.operator.H_i
        return (H_i == H_i.min()) / length

    return short(values, h, H, budget, start)


def near(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Points of T_H inside the sides are that far from mesh vertices.

    D changes by at most twice that distance over H.
    """
    mesh, aligned = structured_square(h), uniform(square(), H)
    inside = ~np.isin(aligned.points, square().starts)
    there = posed(mesh, aligned, waves).spaces.operator.D

    def problem(distance: float) -> ExtremeProblem:
        return posed(mesh, Partition(square(), aligned.points + distance * inside), waves)

    def change(of: ExtremeProblem, _: Array) -> float:
        return float(np.abs(of.spaces.operator.D - there).max() / np.abs(there).max())

    rows = attempts(values, problem, budget, change)
    return Axis(within(predicted(rows, 2 * values / H), SLACK))


def kernel(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h takes those values, and g is orthogonal to the kernel of S.

    The number tells how far another multiplier with the same u_h is.
    """

    def distance(of: ExtremeProblem, mu: Array) -> float:
        return of.distance(mu, of.lambda_H)

    return Axis(attempts(values, lambda size: _contact_at_h(size, 0.0), budget, distance), NOTHING)


def kernel_loaded(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h, and that gap on every other cell makes lambda_H unique.

    The number tells how far lambda_H is from a smooth multiplier.
    """

    def distance(of: ExtremeProblem, mu: Array) -> float:
        return of.distance(mu, smoothed(of.lambda_H))

    rows = attempts(values, lambda gap: _contact_at_h(h, gap), budget, distance)
    known = _contact_at_h(h, float(values[0]))
    return Axis(predicted(rows, np.full(len(rows), distance(known, known.lambda_H))), NOTHING)


def smoothed(lambda_H: Array) -> Array:
    """The multiplier (m,) without what B^T does not see, the kernel (-1)^i of equal cells at H = h."""
    kernel = (-1.0) ** np.arange(len(lambda_H))
    return np.asarray(lambda_H - kernel * (kernel @ lambda_H) / len(lambda_H))


def _contact_at_h(h: float, gap: float) -> ExtremeProblem:
    """Contact on all cells, or with that gap on every other one."""

    def contact(partition: Partition) -> tuple[Array, Array]:
        free = (np.arange(partition.n_cells) % 2 == 1) & (gap > 0)
        return full(partition)[0] * ~free, gap * free

    return on_square(h, h, contact)
