"""u_h at any points: linear on triangles."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.geometry.checks import round_off
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.polygon import Polygon

OUTSIDE = 1e-10
"""Of the polygon's diameter: how far outside a point may lie and count as one of the boundary."""


def at_points(mesh: Mesh, u_h: Array, points: Array) -> Array:
    """(k,) u_h (n,) at the points (k, 2), NaN outside the polygon; the boundary belongs to the polygon."""
    from matplotlib.tri import Triangulation

    triangulation = Triangulation(mesh.points[:, 0], mesh.points[:, 1], mesh.triangles)
    found = np.asarray(triangulation.get_trifinder()(*points.T), dtype=np.intp)
    values, inside = np.full(len(points), np.nan), found >= 0
    values[inside] = _linear(mesh, u_h, points[inside], mesh.triangles[found[inside]])
    off = np.flatnonzero(~inside)
    s, distance = _nearest(mesh.polygon, points[off])
    near = distance <= OUTSIDE * mesh.polygon.diameter + round_off(mesh.polygon)
    trace = np.append(u_h[mesh.boundary], u_h[mesh.boundary[0]])
    values[off[near]] = np.interp(s[near], mesh.s, trace)
    return values


def _linear(mesh: Mesh, u_h: Array, points: Array, nodes: Index) -> Array:
    """(k,) on the triangles with the nodes (k, 3), by barycentric coordinates."""
    corners, values = mesh.points[nodes], u_h[nodes]
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    weights = np.linalg.solve(edges, (points - corners[:, 0])[..., None])[..., 0]
    return values[:, 0] + np.sum(weights * (values[:, 1:] - values[:, :1]), axis=1)


def _nearest(polygon: Polygon, points: Array) -> tuple[Array, Array]:
    """The arc lengths (k,) of the places on the boundary that are nearest to points (k, 2), and how far."""
    s, distance = np.zeros(len(points)), np.full(len(points), np.inf)
    for side, (vertex, tangent) in enumerate(zip(polygon.vertices, polygon.tangents, strict=True)):
        t = np.clip((points - vertex) @ tangent, 0, polygon.lengths[side])
        away = np.hypot(*(points - vertex - t[:, None] * tangent).T)
        s = np.where(away < distance, polygon.starts[side] + t, s)
        distance = np.fmin(away, distance)
    return s, distance
