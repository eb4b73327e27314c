"""Finds the triangles of a mesh in which points lie, by boxes about 1, 2, 4, .. neighbouring triangles."""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross

MAX_POINTS_LOCATED = 1 << 16
"""At most this many points are located at once."""
Z_ORDER_BITS = 26
"""Triangles are ordered by this many bits of a coordinate; nearer ones are in any order."""
ROUNDING_PER_COORDINATE = 2.0**-48
"""Rounding may move a point out of its triangle by this part of the largest coordinate."""


def locate_in_triangles(mesh: Mesh, points: Array) -> tuple[Index, Index, Array]:
    """Pairs of points (k, 2) and triangles in which they lie: (p,), (p,) and barycentric coordinates (p, 3).

    A point on an edge, up to rounding, has a pair with each triangle there; one outside has none.
    """
    corners = mesh.points[mesh.triangles]
    reach = ROUNDING_PER_COORDINATE * float(np.abs(mesh.points).max())
    order = _z_order(corners.mean(axis=1))
    boxes = _box_tree(corners.min(axis=1)[order] - reach, corners.max(axis=1)[order] + reach)
    # Pairs of a point and a triangle's box, in blocks of points
    blocks = np.array_split(np.arange(len(points)), 1 + len(points) // MAX_POINTS_LOCATED)
    box_pairs = [_pair_with_boxes(boxes, points[block]) for block in blocks]
    point = np.concatenate([block[number] for block, (number, _) in zip(blocks, box_pairs, strict=True)])
    triangle = order[np.concatenate([box for _, box in box_pairs])]
    # The distance from an edge is weight * height, and may be -reach by rounding
    weights, heights = _barycentric_with_heights(corners[triangle], points[point])
    inside = (weights >= -reach / heights).all(axis=1)
    return point[inside], triangle[inside], weights[inside]


def _box_tree(low: Array, high: Array) -> list[tuple[Array, Array]]:
    """The boxes from `low` to `high` (m, 2), those about pairs of neighbours, and so on up to one about all.

    Box i has the boxes 2 i and 2 i + 1 of the entry before; the last box may have only one.
    """
    boxes = [(low, high)]
    while len(low) > 1:
        pairs = np.arange(0, len(low), 2)
        low = np.minimum.reduceat(low, pairs)
        high = np.maximum.reduceat(high, pairs)
        boxes.append((low, high))
    return boxes


def _pair_with_boxes(boxes: list[tuple[Array, Array]], points: Array) -> tuple[Index, Index]:
    """The pairs of a point and a box of boxes[0] that contains it, as do all boxes about that one."""
    # From the box about all down to boxes[0]: both halves of each box that contains the point are tried
    point = np.arange(len(points))
    box = np.zeros(len(points), dtype=np.intp)
    for low, high in boxes[::-1]:
        # the second half is missing where the number of boxes was odd
        point = point[box < len(low)]
        box = box[box < len(low)]
        within = ((points[point] >= low[box]) & (points[point] <= high[box])).all(axis=1)
        point = point[within]
        box = box[within]
        if low is not boxes[0][0]:
            point = np.tile(point, 2)
            box = np.concatenate([2 * box, 2 * box + 1])
    return point, box


def _barycentric_with_heights(corners: Array, points: Array) -> tuple[Array, Array]:
    """Barycentric coordinates of points in their triangles, and the heights of these, (p, 3) each."""
    # Weight i is the area spanned by the point and edge i, over the triangle's; height i is 2 |T| / |edge i|
    edges = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    twice = cross(edges[:, 0], edges[:, 1])[:, None]
    away = cross(edges, points[:, None] - np.roll(corners, -1, axis=1))
    return away / twice, twice / np.linalg.norm(edges, axis=2)


def _z_order(points: Array) -> Index:
    """The order (m,) of points along a Z curve, on which most neighbours are near, by bits of both axes."""
    low = points.min(axis=0)
    size = np.ptp(points, axis=0).max() or 1.0
    cells = ((points - low) / size * (2**Z_ORDER_BITS - 1)).astype(np.int64)
    # Bit b of x and y is bit 2 b and 2 b + 1 of the place on the curve
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(Z_ORDER_BITS):
        for axis in range(2):
            code |= ((cells[:, axis] >> bit) & 1) << (2 * bit + axis)
    return np.argsort(code, kind="stable")
