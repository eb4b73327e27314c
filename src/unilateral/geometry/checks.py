"""The checks that every triangulation of a polygon has to pass."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.geometry.plane import longest_edges, segment_distances, signed_areas
from unilateral.geometry.polygon import Polygon

TOLERANCE = 1e-10
"""Of positions relative to the polygon's diameter, and of areas relative to the polygon's."""
SAME_POINT = 1e-12
"""Nodes nearer than this part of the diameter are one node listed twice."""
FLAT = 1e-12
"""Triangles whose area is below this part of their longest edge squared are degenerate."""


def round_off(polygon: Polygon) -> float:
    """How far round-off may move a point of the polygon."""
    return 8 * float(np.finfo(float).eps) * (polygon.perimeter + float(np.abs(polygon.vertices).max()))


def node(points: Array, number: int) -> str:
    """A node as it appears in messages."""
    return f"{number} ({points[number, 0]:.6g}, {points[number, 1]:.6g})"


def check_arrays(points: Array, triangles: Index, where: str) -> None:
    """Raises InputError unless the points (n, 2) are finite and the triangles (m, 3) made of all of them."""
    if points.ndim != 2 or points.shape[1] != 2:
        raise InputError(f"{where}: the points have the shape {points.shape} instead of (n, 2)")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
        raise InputError(f"{where}: the triangles have the shape {triangles.shape} instead of (m, 3), m > 0")
    infinite = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if infinite.size:
        raise InputError(f"{where}: node {infinite[0]} has a coordinate that is not a finite number")
    wrong = np.flatnonzero(((triangles < 0) | (triangles >= len(points))).any(axis=1))
    if wrong.size:
        raise InputError(
            f"{where}: triangle {wrong[0]} has the nodes {triangles[wrong[0]].tolist()}, "
            f"but the nodes' numbers run from 0 to {len(points) - 1}"
        )
    unused = np.flatnonzero(np.bincount(triangles.ravel(), minlength=len(points)) == 0)
    if unused.size:
        raise InputError(f"{where}: node {node(points, unused[0])} belongs to no triangle; leave it out")


def check_triangles(polygon: Polygon, points: Array, triangles: Index, where: str) -> None:
    """Raises InputError if two nodes coincide, or a triangle is clockwise or degenerate."""
    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    distance, nearest = tree.query(points, k=2, distance_upper_bound=SAME_POINT * polygon.diameter)
    twice = np.flatnonzero(np.isfinite(distance[:, 1]))
    if twice.size:
        first = int(twice[0])
        second = int(nearest[first][nearest[first] != first][0])
        raise InputError(f"{where}: node {second} repeats node {node(points, first)}; list every node once")
    areas = signed_areas(points, triangles)
    limit = FLAT * longest_edges(points, triangles) ** 2
    wrong = np.flatnonzero(areas <= limit)
    if wrong.size:
        k = wrong[0]
        fault = (
            "clockwise; list its nodes anticlockwise"
            if areas[k] < -limit[k]
            else "degenerate; it needs an area"
        )
        raise InputError(f"{where}: triangle {k} with the nodes {triangles[k].tolist()} is {fault}")


def boundary_edges(points: Array, triangles: Index, where: str) -> Index:
    """(nb, 2) the edges that belong to one triangle only, directed as in it.

    Raises InputError if two triangles lie on the same side of an edge, as of any three at least two do.
    """
    n = len(points)
    a, b = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    keys = np.sort(2 * (np.minimum(a, b) * n + np.maximum(a, b)) + (a > b))
    edges = keys >> 1
    crowded = np.flatnonzero(keys[1:] == keys[:-1])
    if crowded.size:
        low, high = divmod(int(edges[crowded[0]]), n)
        count = np.count_nonzero(edges == edges[crowded[0]])
        raise InputError(
            f"{where}: the edge from node {node(points, low)} to node {node(points, high)} belongs to "
            f"{count} triangles, two of them on the same side; it may have one on either side"
        )
    repeated = edges[1:] == edges[:-1]
    once = ~(np.append(repeated, False) | np.append(False, repeated))
    pairs = np.column_stack(np.divmod(edges[once], n))
    return np.where((keys[once] & 1)[:, None] == 1, pairs[:, ::-1], pairs)


def sides(polygon: Polygon, points: Array, edges: Index, tolerance: float, where: str) -> Index:
    """(nb,) the side each of the boundary edges (nb, 2) runs along; InputError if one runs along none."""
    ends = np.roll(polygon.vertices, -1, axis=0)
    distance = [segment_distances(points[k], polygon.vertices, ends) for k in edges.T]
    forward = (points[edges[:, 1]] - points[edges[:, 0]]) @ polygon.tangents.T > 0
    off = np.where(forward, np.maximum(*distance), np.inf)
    stray = edges[off.min(axis=1) > tolerance]
    if stray.size:
        a, b = stray[np.hypot(*(points[stray[:, 1]] - points[stray[:, 0]]).T).argmax()]
        raise InputError(
            f"{where}: the boundary edge from node {node(points, a)} to node {node(points, b)} does not run "
            f"anticlockwise along one side of polygon '{polygon.name}'; move its nodes there, close a gap "
            "beside it, or split its triangle at a node that hangs on it"
        )
    return off.argmin(axis=1)
