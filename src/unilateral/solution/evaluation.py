"""u_h, its gradient and its flux at any points: linear on triangles."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, floats
from unilateral.bounds.flux_residuals import misfit
from unilateral.errors import InputError
from unilateral.fem.p1 import gradients
from unilateral.geometry.locate import containing
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import round_off
from unilateral.problems import arguments

OUTSIDE = 1e-10
"""A point outside counts as one of the boundary up to this fraction of the polygon's diameter away."""


class Located(NamedTuple):
    """The triangle (k,) in which each of k points lies, -1 outside, and barycentric coordinates (k, 3)."""

    triangle: Index
    weights: Array

    def values(self, of: Callable[[Index, Array], Array]) -> Array:
        """(k, ...) what `of` gives for triangles (m,) and coordinates in these (m, 3); NaN outside."""
        inside = self.triangle >= 0
        found = of(self.triangle[inside], self.weights[inside])
        values = np.full((len(inside), *found.shape[1:]), np.nan)
        values[inside] = found
        return values


def at_points(mesh: Mesh, points: ArrayLike, evaluate: Callable[[Index, Array], Array]) -> Array:
    """Values at a point (2,) or at many (k, 2), as an array (...) or (k, ...); NaN outside the polygon.

    `evaluate` is as in `Located.values`. Raises InputError for another shape.
    """
    places = floats(points, "points")
    if places.ndim not in (1, 2) or places.shape[-1] != 2:
        raise InputError(
            f"points: their shape {places.shape} must be (2,), a point, or (k, 2), a row for each point"
        )
    values = located(mesh, places.reshape(-1, 2)).values(evaluate)
    return values.reshape((*places.shape[:-1], *values.shape[1:]))


def on_side(cells: Partition, values: Array, side: int, t: ArrayLike) -> Array:
    """What has the `values` (m,) on the cells, at the arc lengths t from the start of a side; NaN beyond it.

    Raises InputError for a side that is not there.
    """
    polygon = cells.polygon
    s = floats(t, "t")
    side = arguments.side(side, polygon.n_sides, "side")
    own = np.flatnonzero(cells.side == side)
    starts = cells.points[own] - polygon.starts[side]
    inside = (s >= 0) & (s <= polygon.lengths[side])
    cell = own[np.searchsorted(starts, np.where(inside, s, 0.0), side="right") - 1]
    return np.where(inside, values[cell], math.nan)


def located(mesh: Mesh, points: Array) -> Located:
    """Where the points (k, 2) lie; the boundary belongs to the polygon.

    On an edge or at a node that is the triangle with the least number.
    """
    triangle = np.full(len(points), -1)
    weights = np.full((len(points), 3), np.nan)
    at, found, of_found = containing(mesh, points)
    least = np.lexsort([found, at])
    least = least[np.unique(at[least], return_index=True)[1]]
    triangle[at[least]] = found[least]
    weights[at[least]] = of_found[least]
    off = np.flatnonzero(triangle < 0)
    s, distance = _nearest(mesh.polygon, points[off])
    near = distance <= OUTSIDE * mesh.polygon.diameter + round_off(mesh.polygon)
    edge, share = _on_edges(mesh, s[near])
    triangle[off[near]] = mesh.boundary_triangles[edge]
    nodes = mesh.triangles[mesh.boundary_triangles[edge]]
    start = mesh.boundary[edge, None]
    after = np.roll(mesh.boundary, -1)[edge, None]
    weights[off[near]] = (nodes == start) * (1 - share[:, None]) + (nodes == after) * share[:, None]
    return Located(triangle, weights)


def _on_edges(mesh: Mesh, s: Array) -> tuple[Index, Array]:
    """The boundary edges (k,) of the arc lengths s (k,), and where on these they are, from 0 to 1."""
    edge = np.minimum(np.searchsorted(mesh.s, s, side="right"), len(mesh.boundary)) - 1
    return edge, (s - mesh.s[edge]) / np.diff(mesh.s)[edge]


def value(mesh: Mesh, u_h: Array, triangles: Index, weights: Array) -> Array:
    """(m,) u_h (n,) at a point of each of the triangles (m,), by its coordinates there (m, 3)."""
    return np.einsum("mi,mi->m", weights, u_h[mesh.triangles[triangles]])


def gradient(mesh: Mesh, u_h: Array, triangles: Index) -> Array:
    """(m, 2) grad u_h on the triangles (m,)."""
    return np.einsum("mid,mi->md", gradients(mesh.part(triangles)), u_h[mesh.triangles[triangles]])


def flux(mesh: Mesh, u_h: Array, q: Array, triangles: Index, weights: Array) -> Array:
    """(m, 2) the flux q, given on edges as by `equilibrated`, at the points of `value`."""
    away = np.einsum("mi,mid->md", weights, misfit(mesh, u_h, q, triangles))
    return gradient(mesh, u_h, triangles) - away


def _nearest(polygon: Polygon, points: Array) -> tuple[Array, Array]:
    """The arc lengths (k,) of the places on the boundary that are nearest to points (k, 2), and how far."""
    s = np.zeros(len(points))
    distance = np.full(len(points), np.inf)
    for side, (vertex, tangent) in enumerate(zip(polygon.vertices, polygon.tangents, strict=True)):
        t = np.clip((points - vertex) @ tangent, 0, polygon.lengths[side])
        away = np.hypot(*(points - vertex - t[:, None] * tangent).T)
        s = np.where(away < distance, polygon.starts[side] + t, s)
        distance = np.fmin(away, distance)
    return s, distance
