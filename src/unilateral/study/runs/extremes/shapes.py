"""Axes of the domain and its mesh: its size, its place, thin parts, flat triangles."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from unilateral.errors import InputError
from unilateral.fem.condense import CONSTANTS
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import tensor
from unilateral.study.runs.extremes.outcome import Axis, Budget, crossing, predicted, within
from unilateral.study.runs.extremes.problem import Array, Contact, Problem, full, posed, waves
from unilateral.study.runs.extremes.trial import attempts, condition

SLACK = 1e-12
"""Relative changes below it are rounding."""


def _scaled(L: float) -> Polygon:
    """The square with sides of that length: cond(S) ~ L^-2."""
    return Polygon(L * square().vertices, "square")


def _needle(angle: float) -> Polygon:
    """A right triangle with that angle."""
    return Polygon(np.array([[0, 0], [1, 0], [1, np.tan(angle)]]), "needle")


def _slit(width: float) -> Polygon:
    """A square with a slit of that width, half as long as a side."""
    a, b = 0.5 - width / 2, 0.5 + width / 2
    corners = [[0, 0], [a, 0], [a, 0.5], [b, 0.5], [b, 0], [1, 0], [1, 1], [0, 1]]
    return Polygon(np.array(corners), "slit")


def _cut(length: float) -> Polygon:
    """A square with a corner cut off so that a side of that length is left."""
    d = length / np.sqrt(2)
    return Polygon(np.array([[0, 0], [1 - d, 0], [1, d], [1, 1], [0, 1]]), "cut square")


def _thin(
    values: Array,
    h: float,
    H: float,
    budget: Budget,
    shape: Callable[[float], Polygon],
    contact: Contact,
) -> Axis:
    """h and H in units of the longest side; cond(S) ~ |boundary|/(|Omega| min H_i), from the first one's.

    That is a law of its growth: where it would fall, nothing is predicted.
    """

    def mesh(polygon: Polygon) -> Mesh:
        return meshes.unstructured(polygon, h * polygon.lengths.max())

    def problem(value: float) -> Problem:
        polygon = shape(value)
        partition = uniform(polygon, H * polygon.lengths.max())
        return posed(mesh(polygon), partition, contact)

    def lost(polygon: Polygon) -> float:
        """As `_rounding`; infinite where there is no mesh."""
        try:
            return _rounding(mesh(polygon))
        except InputError:
            return np.inf

    rows, polygons = attempts(values, problem, budget, condition), [shape(value) for value in values]
    law = np.array([_law(polygon, H) for polygon in polygons])
    numbers = np.where(law >= law[0], rows[0].measured * law / law[0], np.nan)
    refused = np.array([lost(polygon) for polygon in polygons]) / CONSTANTS
    limit = crossing(values, numbers, budget.condition)
    tool = crossing(values, np.maximum(numbers / budget.accelerated, refused), 1.0)
    return Axis(predicted(rows, numbers), limit, tool)


def scaled(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Squares with sides of those lengths, in full contact."""
    return _thin(values, h, H, budget, _scaled, full)


def angle(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Needles with those angles, in full contact."""
    return _thin(values, h, H, budget, _needle, full)


def slit(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Slits of those widths, in partial contact."""
    return _thin(values, h, H, budget, _slit, waves)


def side(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Sides of those lengths, in partial contact."""
    return _thin(values, h, H, budget, _cut, waves)


def aspect(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Strips of triangles of that aspect ratio along two sides of the square; cond(S) stays as it is."""
    n, partition = square().counts(h)[0], uniform(square(), H)

    def mesh(ratio: float) -> Mesh:
        return tensor(np.unique(np.append(np.arange(n + 1) / n, 1 / (n * ratio))))

    rows = attempts(values, lambda ratio: posed(mesh(ratio), partition, waves), budget, condition)
    limit = crossing(values, np.array([_rounding(mesh(ratio)) for ratio in values]), CONSTANTS)
    return Axis(predicted(rows, np.full(len(rows), rows[0].measured)), limit, limit)


def moved(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The square moved that far: the change of S, and the share of an edge by which rounding moves nodes."""

    def problem(distance: float) -> Problem:
        polygon = Polygon(square().vertices + distance * np.array([1, -1]), "square")
        return posed(meshes.unstructured(polygon, h), uniform(polygon, H), waves)

    here = problem(0.0).spaces.operator.S

    def change(of: Problem, _: Array) -> float:
        return float(np.abs(of.spaces.operator.S - here).max() / np.abs(here).max())

    rows = attempts(values, problem, budget, change)
    limit = meshes.ROUNDED * h / float(np.finfo(float).eps)
    return Axis(within(predicted(rows, np.spacing(values) / h), SLACK), limit, limit)


def _rounding(mesh: Mesh) -> float:
    """What rounding of K 1 = 0 does to constants: eps ||diag K||_2 / |Omega|."""
    diagonal = stiffness_and_mass(mesh)[0].diagonal()
    return float(np.finfo(float).eps * np.linalg.norm(diagonal) / mesh.polygon.area)


def _law(polygon: Polygon, H: float) -> float:
    """lambda_max(S) >= |boundary|/|Omega|, by constants, and lambda_min(S) ~ the shortest cell."""
    shortest = uniform(polygon, H * polygon.lengths.max()).lengths.min()
    return polygon.perimeter / polygon.area / float(shortest)
