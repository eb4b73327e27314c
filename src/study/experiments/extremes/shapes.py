"""Axes of the domain and its mesh: its size, its place, thin parts, flat triangles."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from study.experiments.extremes.outcome import (
    Axis,
    Budget,
    attempts,
    condition,
    crossing,
    predicted,
    within,
)
from study.experiments.extremes.problem import Contact, ExtremeProblem, full, posed, waves
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.condense import CONSTANTS
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import tensor

SLACK = 1e-12
"""Relative changes below this number are rounding."""


def scaled(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The square has sides of that length L, with h and H in proportion and full contact: cond(S) ~ L^-2."""
    return _thin(lambda L: Polygon(L * square().vertices, "square"), values, h, H, budget, full)


def angle(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """A right triangle with that angle."""

    def of(a: float) -> Polygon:
        return Polygon(np.array([[0, 0], [1, 0], [1, np.tan(a)]]), "needle")

    return _thin(of, values, h, H, budget, full)


def slit(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """A square with a slit of that width, half as long as a side."""

    def of(w: float) -> Polygon:
        a, b = 0.5 - w / 2, 0.5 + w / 2
        corners = [[0, 0], [a, 0], [a, 0.5], [b, 0.5], [b, 0], [1, 0], [1, 1], [0, 1]]
        return Polygon(np.array(corners), "slit")

    return _thin(of, values, h, H, budget, waves)


def side(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """A square with a corner cut off so that a side of that length is left."""

    def of(length: float) -> Polygon:
        d = length / np.sqrt(2)
        return Polygon(np.array([[0, 0], [1 - d, 0], [1, d], [1, 1], [0, 1]]), "cut square")

    return _thin(of, values, h, H, budget, waves)


def aspect(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Strips of triangles of that aspect ratio along two sides of the square; cond(S) stays as it is."""
    n, partition = square().counts(h)[0], uniform(square(), H)

    def mesh(ratio: float) -> Mesh:
        return tensor(np.unique(np.append(np.arange(n + 1) / n, 1 / (n * ratio))))

    rows = attempts(values, lambda ratio: posed(mesh(ratio), partition, waves), budget, condition)
    limit = crossing(values, np.array([_rounding(mesh(ratio)) for ratio in values]), CONSTANTS)
    return Axis(predicted(rows, np.full(len(rows), rows[0].measured)), limit, limit)


def moved(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The square is moved that far. The number is the change of S.

    Its prediction is the share of an edge by which rounding moves nodes.
    """

    def problem(distance: float) -> ExtremeProblem:
        polygon = Polygon(square().vertices + distance * np.array([1, -1]), "square")
        return posed(meshes.unstructured(polygon, h), uniform(polygon, H), waves)

    here = problem(0.0).spaces.operator.S

    def change(of: ExtremeProblem, _: Array) -> float:
        return float(np.abs(of.spaces.operator.S - here).max() / np.abs(here).max())

    rows = attempts(values, problem, budget, change)
    limit = meshes.ROUNDED * h / float(np.finfo(float).eps)
    return Axis(within(predicted(rows, np.spacing(values) / h), SLACK), limit, limit)


def _thin(
    of: Callable[[float], Polygon],
    values: Array,
    h: float,
    H: float,
    budget: Budget,
    contact: Contact,
) -> Axis:
    """The axis of a family of polygons, with h and H in units of the longest side.

    cond(S) is predicted to grow like |boundary|/(|Omega| min H_i) from its first value. Where that law would
    have it fall below the first value, nothing is predicted.
    """

    @cache
    def mesh(value: float) -> Mesh:
        polygon = of(value)
        return meshes.unstructured(polygon, h * polygon.lengths.max())

    def problem(value: float) -> ExtremeProblem:
        polygon = mesh(value).polygon
        partition = uniform(polygon, H * polygon.lengths.max())
        return posed(mesh(value), partition, contact)

    def lost(value: float) -> float:
        """The number of `_rounding`; infinite where there is no mesh."""
        try:
            return _rounding(mesh(value))
        except InputError:
            return np.inf

    rows = attempts(values, problem, budget, condition)
    law = np.array([_law(of(value), H) for value in values])
    numbers = np.where(law >= law[0], rows[0].measured * law / law[0], np.nan)
    refused = np.array([lost(value) for value in values.tolist()]) / CONSTANTS
    limit = crossing(values, numbers, budget.condition)
    tool = crossing(values, np.maximum(numbers / budget.accelerated, refused), 1.0)
    return Axis(predicted(rows, numbers), limit, tool)


def _rounding(mesh: Mesh) -> float:
    """What rounding of K 1 = 0 does to constants: eps ||diag K||_2 / |Omega|."""
    diagonal = stiffness_and_mass(mesh)[0].diagonal()
    return float(np.finfo(float).eps * np.linalg.norm(diagonal) / mesh.polygon.area)


def _law(polygon: Polygon, H: float) -> float:
    """The law of cond(S): by constants lambda_max(S) >= |boundary|/|Omega|, and lambda_min(S) ~ min H_i."""
    shortest = uniform(polygon, H * polygon.lengths.max()).lengths.min()
    return polygon.perimeter / polygon.area / float(shortest)
