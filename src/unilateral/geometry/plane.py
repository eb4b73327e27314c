"""Vectors, segments and triangles of the plane."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks

SIDES_PER_BLOCK = 32
"""So many sides of a polygon are compared with all its sides at a time."""


def cross(a: Array, b: Array) -> Array:
    """Signed areas (...) of the parallelograms that vectors (..., 2) span, above 0 where b is left of a."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def segment_distances(points: Array, starts: Array, ends: Array) -> Array:
    """Distances of all points from all segments, (k, n)."""
    # The nearest point of the segment a + t e is at t = (p - a).e / |e|^2, cut to [0, 1]
    directions = ends - starts
    offsets = points[:, None] - starts
    t = np.clip(np.sum(offsets * directions, axis=2) / np.sum(directions**2, axis=1), 0, 1)
    apart = offsets - t[..., None] * directions
    return np.hypot(apart[..., 0], apart[..., 1])


def corner_coordinates(points: Array, triangles: Index) -> tuple[Array, Array]:
    """x and y of the corners of triangles (k, 3), (3, k) each; `take` reads points several times faster."""
    corners = points.take(triangles.T, axis=0)
    return corners[..., 0], corners[..., 1]


def signed_areas(points: Array, triangles: Index) -> Array:
    """Areas of the triangles, negative where the nodes run clockwise, (m,)."""
    areas = np.empty(len(triangles))
    for block in row_blocks(len(areas)):
        x, y = corner_coordinates(points, triangles[block])
        areas[block] = 0.5 * ((x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]))
    return areas


def longest_edges(points: Array, triangles: Index) -> Array:
    """The length of the longest edge of each triangle, (m,)."""
    longest = np.empty(len(triangles))
    for block in row_blocks(len(longest)):
        x, y = corner_coordinates(points, triangles[block])
        lengths = [np.hypot(x[i] - x[j], y[i] - y[j]) for i, j in ((1, 0), (2, 1), (0, 2))]
        longest[block] = np.maximum(np.maximum(lengths[0], lengths[1]), lengths[2])
    return longest


def centroid_circles(vertices: Array) -> tuple[Array, Array]:
    """The centroids (k, 2) of triangles with `vertices` (k, 3, 2), and how far (k,) a vertex is at most."""
    a, b, c = np.moveaxis(vertices, 1, 0)
    centre = (a + b + c) / 3
    distances = [np.hypot(*(corner - centre).T) for corner in (a, b, c)]
    return centre, np.maximum(np.maximum(distances[0], distances[1]), distances[2])


def first_crossing(vertices: Array) -> tuple[int, int] | None:
    """The first two sides of a polygon with the vertices (n, 2) that meet elsewhere than in one of them."""
    after = np.roll(vertices, -1, axis=0)
    low = np.minimum(vertices, after)
    high = np.maximum(vertices, after)
    for block in row_blocks(len(vertices), SIDES_PER_BLOCK):
        # sides i < j can only meet where the smallest rectangles around them do
        apart = (low[block, None] > high) | (high[block, None] < low)
        i, j = np.nonzero(np.triu(~apart.any(axis=2), block.start + 1))
        i += block.start
        meeting = np.flatnonzero(_sides_meet(vertices, after, i, j))
        if meeting.size:
            return int(i[meeting[0]]), int(j[meeting[0]])
    return None


def _sides_meet(starts: Array, ends: Array, i: Index, j: Index) -> Mask:
    """Whether sides i (k,) meet the later sides j (k,) elsewhere than in a vertex they share, (k,)."""
    meets = _segments_meet(starts[i], ends[i], starts[j], ends[j])
    # Neighbours share a vertex, and meet elsewhere only if one folds back over the other
    follows = (j == i + 1)[:, None]
    precedes = (i == 0) & (j == len(starts) - 1)
    shared = np.where(follows, ends[i], starts[i])
    along_i = np.where(follows, starts[i], ends[i]) - shared
    along_j = np.where(follows, ends[j], starts[j]) - shared
    folded = (cross(along_i, along_j) == 0) & (np.sum(along_i * along_j, axis=1) > 0)
    return np.where(follows[:, 0] | precedes, folded, meets)


def _segments_meet(a: Array, b: Array, c: Array, d: Array) -> Mask:
    """Whether each segment from a to b (k, 2) meets that from c to d (k, 2), (k,)."""
    # They cross if each has its ends on different sides of the other one's line
    abc = cross(b - a, c - a)
    abd = cross(b - a, d - a)
    cda = cross(d - c, a - c)
    cdb = cross(d - c, b - c)
    meets = (np.sign(abc) != np.sign(abd)) & (np.sign(cda) != np.sign(cdb))
    # They touch if an end r of one lies on the other, pq: on its line and not beyond its ends
    for p, q, r, area in ((a, b, c, abc), (a, b, d, abd), (c, d, a, cda), (c, d, b, cdb)):
        meets |= (area == 0) & (np.sum((r - p) * (r - q), axis=1) <= 0)
    return meets
