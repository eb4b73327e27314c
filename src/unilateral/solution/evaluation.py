"""u_h, its gradient and its flux at any points: linear on triangles."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from unilateral.arrays import Array, Index, read_floats
from unilateral.bounds.flux_residuals import misfit
from unilateral.errors import InputError
from unilateral.fem.p1 import gradients
from unilateral.geometry.locate import locate_in_triangles
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import round_off
from unilateral.problems import arguments

MAX_DISTANCE_OUTSIDE = 1e-10
"""A point outside counts as one of the boundary up to this fraction of the polygon's diameter away."""


class PointLocations(NamedTuple):
    """The triangle (k,) in which each of k points lies, -1 outside, and barycentric coordinates (k, 3)."""

    triangle: Index
    barycentric: Array

    def evaluate(self, function: Callable[[Index, Array], Array]) -> Array:
        """Values (k, ...) of a function of triangles and barycentric coordinates, NaN outside the polygon."""
        inside = self.triangle >= 0
        values_inside = function(self.triangle[inside], self.barycentric[inside])
        values = np.full((len(inside), *values_inside.shape[1:]), np.nan)
        values[inside] = values_inside
        return values


def evaluate_at_points(mesh: Mesh, points: ArrayLike, function: Callable[[Index, Array], Array]) -> Array:
    """Values at a point (2,) or at many (k, 2), as an array (...) or (k, ...); NaN outside the polygon.

    `function` is as in `PointLocations.evaluate`. Raises InputError for another shape.
    """
    places = read_floats(points, "points")
    if places.ndim not in (1, 2) or places.shape[-1] != 2:
        raise InputError(
            f"points: their shape {places.shape} must be (2,), a point, or (k, 2), a row for each point"
        )
    values = locate_points(mesh, places.reshape(-1, 2)).evaluate(function)
    return values.reshape((*places.shape[:-1], *values.shape[1:]))


def evaluate_on_side(partition: Partition, values: Array, side: int, t: ArrayLike) -> Array:
    """Values of a piecewise constant function at arc lengths from the start of a side, NaN beyond the side.

    Raises InputError for a side that is not there.
    """
    polygon = partition.polygon
    s = read_floats(t, "t")
    side = arguments.as_side_number(side, polygon, "side")
    cells = np.flatnonzero(partition.side == side)
    starts = partition.points[cells] - polygon.starts[side]
    inside = (s >= 0) & (s <= polygon.lengths[side])
    # where two cells meet the later one counts
    cell = cells[np.searchsorted(starts, np.where(inside, s, 0.0), side="right") - 1]
    return np.where(inside, values[cell], math.nan)


def locate_points(mesh: Mesh, points: Array) -> PointLocations:
    """Triangles and barycentric coordinates of points (k, 2); the boundary belongs to the polygon.

    On an edge or at a node it is the triangle with the least number.
    """
    triangle = np.full(len(points), -1)
    barycentric = np.full((len(points), 3), np.nan)
    point, candidate, coordinates = locate_in_triangles(mesh, points)
    # the first pair of each point, in the order of triangles
    order = np.lexsort([candidate, point])
    order = order[np.unique(point[order], return_index=True)[1]]
    triangle[point[order]] = candidate[order]
    barycentric[point[order]] = coordinates[order]
    # points that rounding has put beside the polygon: the nearest ones of the boundary take their places
    outside = np.flatnonzero(triangle < 0)
    s, distance = _project_to_boundary(mesh.polygon, points[outside])
    near = distance <= MAX_DISTANCE_OUTSIDE * mesh.polygon.diameter + round_off(mesh.polygon)
    edge, share = _locate_on_boundary_edges(mesh, s[near])
    triangle[outside[near]] = mesh.boundary_triangles[edge]
    # 1 - share at the edge's start and share at its end; 0 at the third corner
    nodes = mesh.triangles[mesh.boundary_triangles[edge]]
    start = mesh.boundary[edge, None]
    end = np.roll(mesh.boundary, -1)[edge, None]
    barycentric[outside[near]] = (nodes == start) * (1 - share[:, None]) + (nodes == end) * share[:, None]
    return PointLocations(triangle, barycentric)


def _locate_on_boundary_edges(mesh: Mesh, s: Array) -> tuple[Index, Array]:
    """The boundary edges (k,) at the arc lengths s (k,), and the places on them, from 0 to 1."""
    edge = np.minimum(np.searchsorted(mesh.s, s, side="right"), len(mesh.boundary)) - 1
    return edge, (s - mesh.s[edge]) / np.diff(mesh.s)[edge]


def evaluate_u_h(mesh: Mesh, u_h: Array, triangles: Index, barycentric: Array) -> Array:
    """Values (m,) of u_h at one point in each of some triangles (m,)."""
    return np.einsum("mi,mi->m", barycentric, u_h[mesh.triangles[triangles]])


def evaluate_gradient(mesh: Mesh, u_h: Array, triangles: Index) -> Array:
    """Gradients (m, 2) of u_h on some triangles (m,)."""
    slopes = gradients(mesh.select_triangles(triangles))
    # grad u_h = sum over the corners i of u_i grad phi_i
    return np.einsum("mid,mi->md", slopes, u_h[mesh.triangles[triangles]])


def evaluate_flux(mesh: Mesh, u_h: Array, flux: Array, triangles: Index, barycentric: Array) -> Array:
    """Values (m, 2) of the flux of the bound at one point in each of some triangles (m,)."""
    # q = grad u_h - (grad u_h - q): the misfit for k = 1, linear on each triangle
    flux_misfit = np.einsum("mi,mid->md", barycentric, misfit(mesh, u_h, flux, triangles))
    return evaluate_gradient(mesh, u_h, triangles) - flux_misfit


def _project_to_boundary(polygon: Polygon, points: Array) -> tuple[Array, Array]:
    """Arc lengths (k,) of the boundary points that are nearest to points (k, 2), and the distances (k,)."""
    s = np.zeros(len(points))
    distance = np.full(len(points), np.inf)
    for side, (vertex, tangent) in enumerate(zip(polygon.vertices, polygon.tangents, strict=True)):
        # the point of the side that is nearest is vertex + t tangent with t = (x - vertex) . tangent, clipped
        t = np.clip((points - vertex) @ tangent, 0, polygon.lengths[side])
        side_distance = np.hypot(*(points - vertex - t[:, None] * tangent).T)
        s = np.where(side_distance < distance, polygon.starts[side] + t, s)
        distance = np.fmin(side_distance, distance)
    return s, distance
