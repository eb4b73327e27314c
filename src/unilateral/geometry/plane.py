"""Vectors, segments and triangles of the plane."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index, Mask, blocks


def cross(a: Array, b: Array) -> Array:
    """(...) the areas that the vectors a and b (..., 2) span, positive where b lies to the left of a."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def segment_distances(points: Array, starts: Array, ends: Array) -> Array:
    """(k, n) distances of the points (k, 2) from the segments between starts (n, 2) and ends (n, 2)."""
    along = ends - starts
    offset = points[:, None] - starts
    t = np.clip(np.sum(offset * along, axis=2) / np.sum(along**2, axis=1), 0, 1)
    return np.hypot(*np.moveaxis(offset - t[..., None] * along, 2, 0))


def signed_areas(points: Array, triangles: Index) -> Array:
    """(m,) areas of the triangles, negative where the nodes run clockwise."""
    areas = np.empty(len(triangles))
    for some in blocks(len(areas)):
        x, y = points.T[:, triangles[some].T]
        areas[some] = 0.5 * ((x[1] - x[0]) * (y[2] - y[0]) - (y[1] - y[0]) * (x[2] - x[0]))
    return areas


def longest_edges(points: Array, triangles: Index) -> Array:
    """(m,) the longest edge of each triangle."""
    longest = np.empty(len(triangles))
    for some in blocks(len(longest)):
        x, y = points.T[:, triangles[some].T]
        longest[some] = np.hypot(x[[1, 2, 0]] - x, y[[1, 2, 0]] - y).max(axis=0)
    return longest


def circles(vertices: Array) -> tuple[Array, Array]:
    """The centroids (k, 2) of triangles with `vertices` (k, 3, 2), and how far (k,) a vertex is at most."""
    centre = vertices.mean(axis=1)
    away = vertices - centre[:, None]
    return centre, np.hypot(away[..., 0], away[..., 1]).max(axis=1)


def first_crossing(v: Array) -> tuple[int, int] | None:
    """The first two sides of a polygon with the vertices (n, 2) that meet elsewhere than in one of them."""
    after = np.roll(v, -1, axis=0)
    for i in range(len(v) - 1):
        crossed = np.flatnonzero(_meets_later(v, after, i))
        if crossed.size:
            return i, i + 1 + int(crossed[0])
    return None


def _meets_later(v: Array, after: Array, i: int) -> Mask:
    """(n - i - 1,) whether side i meets the sides after it elsewhere than in a vertex they share."""
    n = len(v)
    j = np.arange(i + 1, len(v))
    a = v[i]
    b = after[i]
    c = v[j]
    d = after[j]
    abc = cross(b - a, c - a)
    abd = cross(b - a, d - a)
    cda = cross(d - c, a - c)
    cdb = cross(d - c, b - c)
    proper = (np.sign(abc) != np.sign(abd)) & (np.sign(cda) != np.sign(cdb))
    touching = np.zeros(len(j), dtype=bool)
    for p, q, r, area in ((a, b, c, abc), (a, b, d, abd), (c, d, a, cda), (c, d, b, cdb)):
        touching |= (area == 0) & (np.sum((r - p) * (r - q), axis=1) <= 0)
    follows = j == i + 1
    shared = np.where(follows[:, None], b, a)
    other_i = np.where(follows[:, None], a, b)
    other_j = np.where(follows[:, None], d, c)
    folded = (cross(other_i - shared, other_j - shared) == 0) & (
        np.sum((other_i - shared) * (other_j - shared), axis=1) > 0
    )
    return np.where(follows | ((i == 0) & (j == n - 1)), folded, proper | touching)
