"""The checks that every triangulation of a polygon has to pass."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.errors import InputError
from unilateral.formulas.taylor import EPS
from unilateral.geometry import coordinate_rounding
from unilateral.geometry.plane import longest_edges, segment_distances, signed_areas
from unilateral.geometry.polygon import Polygon

MAX_MOVE_PER_HEIGHT = 1e-6
"""A boundary node may lie beside its side by this part of the least height of the triangles at the node.
Moved onto the side, it changes gradients there by about that part. The bounds are those of the moved mesh."""
MAX_ROUNDED_MOVE = 0.1
"""A node whose coordinates are seen to be rounded may lie beside its side as far as rounding explains, but by
no more than this part of that height, so that no triangle is turned over."""
STRAY_PER_HEIGHT = 0.5
"""A node beside a side by less than this part of that height is told of as one that belongs there."""
MIN_DISTANCE_PER_DIAMETER = 1e-12
"""Nodes nearer than this part of the domain's diameter are one node listed twice."""
MIN_AREA_RATIO = 1e-12
"""Triangles whose area is below this part of their own longest edge squared are degenerate."""


def round_off(polygon: Polygon) -> float:
    """How far round-off may move a point of the polygon, relative to the size of its coordinates."""
    return 8 * EPS * (polygon.perimeter + polygon.largest)


def describe_node(points: Array, node: int) -> str:
    """A node as it appears in messages."""
    return f"{node} ({points[node, 0]:.6g}, {points[node, 1]:.6g})"


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
        node = describe_node(points, unused[0])
        raise InputError(f"{where}: node {node} belongs to no triangle; leave it out")


def orient_anticlockwise(points: Array, triangles: Index) -> Index:
    """The triangles with their nodes anticlockwise: those that run clockwise are reversed, (m, 3)."""
    clockwise = signed_areas(points, triangles) < 0
    return np.where(clockwise[:, None], triangles[:, ::-1], triangles)


def check_distinct_nodes(diameter: float, points: Array, where: str) -> None:
    """Raises InputError if two nodes coincide, on a domain of that diameter."""
    from scipy.spatial import cKDTree  # which meshes that are made here do not need

    tree = cKDTree(points, balanced_tree=False, compact_nodes=False)
    near = MIN_DISTANCE_PER_DIAMETER * (diameter or 1.0)  # it is 0 where all nodes coincide
    # the two nearest nodes of each node, itself among them, in any order where they coincide
    distance, nearest = tree.query(points, k=2, distance_upper_bound=near)
    twice = np.flatnonzero(np.isfinite(distance[:, 1]))
    if twice.size:
        first = int(twice[0])
        second = int(nearest[first][nearest[first] != first][0])
        node = describe_node(points, first)
        raise InputError(f"{where}: node {second} repeats node {node}; list every node once")


def check_areas(points: Array, triangles: Index, where: str) -> None:
    """Raises InputError if a triangle is degenerate."""
    flat = signed_areas(points, triangles) <= MIN_AREA_RATIO * longest_edges(points, triangles) ** 2
    if flat.any():
        k = int(flat.argmax())
        nodes = triangles[k].tolist()
        raise InputError(f"{where}: triangle {k} with the nodes {nodes} is degenerate; it needs an area")


def find_boundary_edges(points: Array, triangles: Index, where: str) -> Index:
    """The edges that belong to one triangle only, directed as in it, (nb, 2).

    Raises InputError if two triangles lie on the same side of an edge, as of any three at least two do.
    """
    n = len(points)
    a = triangles.ravel()
    b = np.roll(triangles, -1, axis=1).ravel()
    # An edge {a, b} is told by min * n + max, and its direction by the last bit: sorted, its triangles meet
    keys = np.sort(2 * (np.minimum(a, b) * n + np.maximum(a, b)) + (a > b))
    edges = keys >> 1
    crowded = np.flatnonzero(keys[1:] == keys[:-1])
    if crowded.size:
        low, high = divmod(int(edges[crowded[0]]), n)
        count = np.count_nonzero(edges == edges[crowded[0]])
        raise InputError(
            f"{where}: the edge from node {describe_node(points, low)} to node {describe_node(points, high)} "
            f"belongs to {count} triangles, two of them on the same side; each side of it may have only one"
        )
    repeated = edges[1:] == edges[:-1]
    once = ~(np.append(repeated, False) | np.append(False, repeated))
    pairs = np.column_stack(np.divmod(edges[once], n))
    return np.where((keys[once] & 1)[:, None] == 1, pairs[:, ::-1], pairs)


def min_heights(points: Array, triangles: Index, edges: Index) -> Array:
    """The least height of the triangles at each node of the boundary edges, 0 at other nodes, (n,)."""
    lowest = np.full(len(points), np.inf)
    lowest[np.delete(np.arange(len(points)), edges)] = 0.0
    beside = triangles[np.isinf(lowest)[triangles].any(axis=1)]
    # A triangle's least height is twice its area over its longest edge
    heights = 2 * np.abs(signed_areas(points, beside)) / longest_edges(points, beside)
    np.minimum.at(lowest, beside, heights[:, None])
    return lowest


def allowed_distances(
    polygon: Polygon, points: Array, edges: Index, heights: Array, may_be_rounded: bool
) -> Array:
    """How far each node of the boundary edges may lie beside its side, round-off for other nodes, (n,).

    The `heights` are the `min_heights`. If coordinates `may_be_rounded`, nodes and the side's ends are each
    as far from their true places as `max_point_error` says, so that twice that counts.
    """
    allowed = MAX_MOVE_PER_HEIGHT * heights + round_off(polygon)
    if not may_be_rounded:
        return allowed
    rounding = 2 * coordinate_rounding.max_point_error(points[edges[:, 0]])
    return allowed + np.minimum(rounding, MAX_ROUNDED_MOVE * heights)


def check_vertices_are_nodes(polygon: Polygon, points: Array, nodes: Index, reach: Array, where: str) -> None:
    """Raises InputError unless one of the boundary's nodes (nb,) lies at each vertex, or within its reach."""
    places = points[nodes]
    nearest = np.array([np.argmin(np.hypot(*(places - vertex).T)) for vertex in polygon.vertices])
    distance = np.hypot(*(places[nearest] - polygon.vertices).T)
    missing = np.flatnonzero(distance > reach[nodes[nearest]])
    if missing.size:
        raise InputError(
            f"{where}: no node lies at vertex {missing[0]} of polygon '{polygon.name}', "
            f"{tuple(polygon.vertices[missing[0]].tolist())}; every vertex has to be a node"
        )


def assign_sides(
    polygon: Polygon, points: Array, edges: Index, reach: Array, heights: Array, where: str
) -> Index:
    """The side along which each boundary edge runs, (nb,); InputError if one runs along none.

    The nodes may lie beside it by their `reach` (n,), the `allowed_distances`.
    """
    starts = polygon.vertices
    ends = np.roll(starts, -1, axis=0)
    # Distances (2, nb, n) of both ends of an edge from all sides, in units of reach
    excess = np.stack([segment_distances(points[k], starts, ends) / reach[k][:, None] for k in edges.T])
    # Both run anticlockwise: a side that an edge runs against, or across, is not its own
    excess[:, (points[edges[:, 1]] - points[edges[:, 0]]) @ polygon.tangents.T <= 0] = np.inf
    side = excess.max(axis=0).argmin(axis=1)
    side_excess = excess[:, np.arange(len(edges)), side]
    stray = np.flatnonzero(side_excess.max(axis=0) > 1)
    if stray.size:
        # The longest such edge is told of, or its farther end if that is near the side: STRAY_PER_HEIGHT
        # takes the place of MAX_MOVE_PER_HEIGHT in `allowed_distances`
        along = points[edges[stray, 1]] - points[edges[stray, 0]]
        worst = stray[np.hypot(*along.T).argmax()]
        end = int(side_excess[:, worst].argmax())
        beside = edges[worst, end]
        if side_excess[end, worst] * reach[beside] < STRAY_PER_HEIGHT * (
            heights[beside] + round_off(polygon) / MAX_MOVE_PER_HEIGHT
        ):
            raise _stray_node_error(polygon, points, beside, side[worst], reach, where)
        raise InputError(
            f"{where}: the boundary edge from node {describe_node(points, edges[worst, 0])} to node "
            f"{describe_node(points, edges[worst, 1])} does not run anticlockwise along one side of polygon "
            f"'{polygon.name}'; move its nodes onto the side, close a gap beside it, or split its triangle "
            "at a hanging node"
        )
    return side


def snap_to_sides(
    polygon: Polygon, points: Array, nodes: Index, side: Index, reach: Array, where: str
) -> Array:
    """The points, with the boundary nodes moved onto the sides of the edges they begin, (n, 2).

    A node goes to the nearest point of its side, and the first node of a side to the vertex. Nodes that are
    there up to round-off stay. Raises InputError for nodes farther away than their `reach` (n,). `nodes` and
    `side` (nb,) are in the order along the boundary.
    """
    # -((x - a).n) n takes a node to its side from a with the normal n; a side's first node goes to a
    from_vertex = points[nodes] - polygon.vertices[side]
    normals = polygon.normals[side]
    shift = -np.sum(from_vertex * normals, axis=1)[:, None] * normals
    shift = np.where((side != np.roll(side, 1))[:, None], -from_vertex, shift)
    away = np.hypot(*shift.T)
    far = np.flatnonzero(away > reach[nodes])
    if far.size:
        raise _stray_node_error(polygon, points, nodes[far[0]], side[far[0]], reach, where)
    beyond = away > round_off(polygon)
    snapped = points.copy()
    snapped[nodes[beyond]] += shift[beyond]
    return snapped


def _stray_node_error(
    polygon: Polygon, points: Array, node: int, side: int, reach: Array, where: str
) -> InputError:
    """The InputError that a node lies farther beside its side than its `reach` (n,)."""
    start = polygon.vertices[side]
    end = polygon.vertices[(side + 1) % polygon.n_sides]
    away = float(segment_distances(points[[node]], start[None], end[None])[0, 0])
    return InputError(
        f"{where}: the boundary node {describe_node(points, node)} lies {away:.2g} off side {side} of "
        f"polygon '{polygon.name}', and at most {reach[node]:.2g} is corrected; move the node onto "
        "the side, give the polygon of the mesh, or read the mesh with polygon= this polygon"
    )
