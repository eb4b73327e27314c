"""u_h at any points: linear on triangles."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.geometry.locate import containing
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import round_off

OUTSIDE = 1e-10
"""A point outside counts as one of the boundary up to this fraction of the polygon's diameter away."""


def at_points(mesh: Mesh, u_h: Array, points: Array) -> Array:
    """(k,) u_h (n,) at the points (k, 2), NaN outside the polygon; the boundary belongs to the polygon."""
    at, triangle, weights = containing(mesh, points)
    values = np.full(len(points), np.nan)
    values[at] = np.sum(weights * u_h[mesh.triangles[triangle]], axis=1)
    off = np.setdiff1d(np.arange(len(points)), at)
    s, distance = _nearest(mesh.polygon, points[off])
    near = distance <= OUTSIDE * mesh.polygon.diameter + round_off(mesh.polygon)
    trace = np.append(u_h[mesh.boundary], u_h[mesh.boundary[0]])
    values[off[near]] = np.interp(s[near], mesh.s, trace)
    return values


def _nearest(polygon: Polygon, points: Array) -> tuple[Array, Array]:
    """The arc lengths (k,) of the places on the boundary that are nearest to points (k, 2), and how far."""
    s, distance = np.zeros(len(points)), np.full(len(points), np.inf)
    for side, (vertex, tangent) in enumerate(zip(polygon.vertices, polygon.tangents, strict=True)):
        t = np.clip((points - vertex) @ tangent, 0, polygon.lengths[side])
        away = np.hypot(*(points - vertex - t[:, None] * tangent).T)
        s = np.where(away < distance, polygon.starts[side] + t, s)
        distance = np.fmin(away, distance)
    return s, distance
