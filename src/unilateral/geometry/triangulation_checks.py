"""The checks that every triangulation of a polygon has to pass."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.formulas.taylor import EPS
from unilateral.geometry import rounding
from unilateral.geometry.plane import longest_edges, segment_distances, signed_areas
from unilateral.geometry.polygon import Polygon

NEAR = 1e-6
"""A boundary node may lie beside its side by this part of the least height of the triangles at the node.

Moved onto the side, it changes gradients there by about that part. The bounds are those of the moved mesh.
"""
MOVED = 0.1
"""A node whose coordinates are seen to be rounded may lie beside its side as far as rounding explains, but by
no more than this part of that height, so that no triangle is turned over."""
BESIDE = 0.5
"""A node beside a side by less than this part of that height is told of as one that belongs there."""
SAME_POINT = 1e-12
"""Nodes nearer than this part of the domain's diameter are one node listed twice."""
FLAT = 1e-12
"""Triangles whose area is below this part of their own longest edge squared are degenerate."""


def round_off(polygon: Polygon) -> float:
    """How far round-off may move a point of the polygon, relative to the size of its coordinates."""
    return 8 * EPS * (polygon.perimeter + polygon.largest)


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


def anticlockwise(points: Array, triangles: Index) -> Index:
    """(m, 3) the triangles with their nodes anticlockwise: those that run clockwise are reversed."""
    clockwise = signed_areas(points, triangles) < 0
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles)


def check_distinct(diameter: float, points: Array, where: str) -> None:
    """Raises InputError if two nodes coincide, on a domain of that diameter."""
    from scipy.spatial import cKDTree  # which meshes that are made here do not need

    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    near = SAME_POINT * (diameter or 1.0)  # it is 0 where all nodes coincide
    distance, nearest = tree.query(points, k=2, distance_upper_bound=near)
    twice = np.flatnonzero(np.isfinite(distance[:, 1]))
    if twice.size:
        first = int(twice[0])
        second = int(nearest[first][nearest[first] != first][0])
        raise InputError(f"{where}: node {second} repeats node {node(points, first)}; list every node once")


def check_areas(points: Array, triangles: Index, where: str) -> None:
    """Raises InputError if a triangle is degenerate."""
    flat = signed_areas(points, triangles) <= FLAT * longest_edges(points, triangles) ** 2
    if flat.any():
        k = int(flat.argmax())
        raise InputError(
            f"{where}: triangle {k} with the nodes {triangles[k].tolist()} is degenerate; it needs an area"
        )


def boundary_edges(points: Array, triangles: Index, where: str) -> Index:
    """(nb, 2) the edges that belong to one triangle only, directed as in it.

    Raises InputError if two triangles lie on the same side of an edge, as of any three at least two do.
    """
    n = len(points)
    a = triangles.ravel()
    b = np.roll(triangles, -1, axis=1).ravel()
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


def least_heights(points: Array, triangles: Index, edges: Index) -> Array:
    """(n,) the least height of the triangles at each node of the boundary edges (nb, 2); 0 at other nodes."""
    found = np.full(len(points), np.inf)
    found[np.delete(np.arange(len(points)), edges)] = 0.0
    there = triangles[np.isinf(found)[triangles].any(axis=1)]
    heights = 2 * np.abs(signed_areas(points, there)) / longest_edges(points, there)
    np.minimum.at(found, there, heights[:, None])
    return found


def reach(polygon: Polygon, points: Array, edges: Index, heights: Array, rounded: bool) -> Array:
    """(n,) how far nodes of the boundary edges (nb, 2) may lie beside their side; round-off for others.

    The `heights` are the `least_heights`. If coordinates may be `rounded`, nodes and the side's ends are each
    as far from their true places as `rounding` tells.
    """
    found = NEAR * heights + round_off(polygon)
    if not rounded:
        return found
    return found + np.minimum(2 * rounding.largest(points[edges[:, 0]]), MOVED * heights)


def sides(polygon: Polygon, points: Array, edges: Index, reach: Array, heights: Array, where: str) -> Index:
    """(nb,) the side each of the boundary edges (nb, 2) runs along; InputError if one runs along none.

    The nodes may lie beside it by their `reach` (n,).
    """
    ends = np.roll(polygon.vertices, -1, axis=0)
    off = np.stack(
        [segment_distances(points[k], polygon.vertices, ends) / reach[k][:, None] for k in edges.T]
    )
    off[:, (points[edges[:, 1]] - points[edges[:, 0]]) @ polygon.tangents.T <= 0] = np.inf
    side = off.max(axis=0).argmin(axis=1)
    least = off[:, np.arange(len(edges)), side]
    stray = np.flatnonzero(least.max(axis=0) > 1)
    if stray.size:
        a, b = edges[stray].T
        worst = stray[np.hypot(*(points[b] - points[a]).T).argmax()]
        (a, b) = edges[worst]
        end = int(least[:, worst].argmax())
        beside = edges[worst, end]
        if least[end, worst] * reach[beside] < BESIDE * (heights[beside] + round_off(polygon) / NEAR):
            raise _beside(polygon, points, beside, side[worst], reach, where)
        raise InputError(
            f"{where}: the boundary edge from node {node(points, a)} to node {node(points, b)} does not run "
            f"anticlockwise along one side of polygon '{polygon.name}'; move its nodes there, close a gap "
            "beside it, or split its triangle at a node that hangs on it"
        )
    return side


def snapped(polygon: Polygon, points: Array, nodes: Index, side: Index, reach: Array, where: str) -> Array:
    """(n, 2) the points, with the boundary nodes (nb,) moved onto the sides (nb,) of the edges they begin.

    A node goes to the nearest point of its side, and the first node of a side to the vertex. Nodes that are
    there up to round-off stay. Raises InputError for nodes farther away than their `reach` (n,).
    """
    from_vertex = points[nodes] - polygon.vertices[side]
    normals = polygon.normals[side]
    by = -np.sum(from_vertex * normals, axis=1)[:, None] * normals
    by = np.where((side != np.roll(side, 1))[:, None], -from_vertex, by)
    away = np.hypot(*by.T)
    found = points.copy()
    far = np.flatnonzero(away > reach[nodes])
    if far.size:
        raise _beside(polygon, points, nodes[far[0]], side[far[0]], reach, where)
    moved = away > round_off(polygon)
    found[nodes[moved]] += by[moved]
    return found


def _beside(polygon: Polygon, points: Array, number: int, side: int, reach: Array, where: str) -> InputError:
    start = polygon.vertices[side]
    end = polygon.vertices[(side + 1) % polygon.n_sides]
    away = float(segment_distances(points[[number]], start[None], end[None])[0, 0])
    return InputError(
        f"{where}: the boundary node {node(points, number)} lies {away:.2g} off side {side} of polygon "
        f"'{polygon.name}', and up to {reach[number]:.2g} would be corrected; move it onto the side, give "
        "the polygon that the mesh has, or read the mesh with polygon= this polygon"
    )
