"""Triangles cut into pieces on which a case's solution is smooth enough for a quadrature rule.

Pieces are triangles given by the barycentric coordinates of their corners in a triangle of the mesh. Pieces
that a kink crosses are quartered at least MIN_KINK_QUARTERINGS times, and until they are smaller than
KINK_PIECE_PER_SIDE of the shortest side (no side counts as shorter than MIN_SIDE_RATIO of the longest) and
than KINK_PIECE_PER_RADIUS of a circle's radius. Towards a singular point pieces are quartered until they are
small against their distance from it; the piece that contains the point is split there into pieces that have
it as their first corner, after it is small against the distance of other points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.geometry.curves import Kink
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import centroid_circles, cross

if TYPE_CHECKING:
    from unilateral.problems.case import ExactSolution

MIN_KINK_QUARTERINGS = 2
KINK_PIECE_PER_SIDE = 1 / 256
KINK_PIECE_PER_RADIUS = 1 / 64
"""Pieces that a kink crosses are quartered so often at least, and until they are that small; see above."""
MIN_SIDE_RATIO = 1 / 64
"""No side counts as shorter than this times the longest one: far from it kinks need no finer pieces."""
MAX_PIECE_QUARTERINGS = 24
"""Pieces are quartered at most so often to separate points, and so often again near points and kinks."""
NEAR_IN_RADII = 3.0
"""A point is near a piece if its distance from the centroid is below this times that of the farthest corner.

At least 3: with that every quarter of a piece that contains the point is near it, so that at level 0 of
`split_triangles` no such quarter is left out.
"""
BARYCENTRIC_TOLERANCE = 1e-10


@dataclass(frozen=True)
class SingularPieces:
    """Pieces of the triangles `parent` (k,), by their `corners` (k, 3, 3).

    The first corner is a singular `point` (k, 2), which has that `grading`.
    """

    corners: Array
    parent: Index
    point: Array
    grading: int


def split_triangles(mesh: Mesh, case: ExactSolution) -> tuple[Array, Index, list[SingularPieces]]:
    """The pieces of all triangles that a kink crosses or that lie at a singular point of the case.

    They are given by their corners (k, 3, 3) in the triangles (k,); those at singular points stand apart, for
    each grading. Every triangle that occurs is covered once; those that do not occur need no splitting.
    """
    points = [(case.polygon.point(p.side, p.t), p.grading) for p in case.flux_singular_points()]
    kinks = case.kinks()
    parent = _find_cut_triangles(mesh, [point for point, _ in points], kinks)
    corners = np.broadcast_to(np.eye(3), (len(parent), 3, 3))
    lengths = case.polygon.lengths
    # a kink's pieces are at most this large
    kink_piece_radius = KINK_PIECE_PER_SIDE * max(lengths.min(), MIN_SIDE_RATIO * lengths.max())
    singular_groups: dict[int, list[tuple[Array, Index, Array]]] = {}
    # the pieces at singular points: each contains one, which becomes the first corner of its parts
    corners, parent = _separate_singular_points(mesh, corners, parent, [point for point, _ in points])
    for point, grading in points:
        contains = _pieces_contain(mesh, corners, parent, point)
        pieces, piece_parent = _split_at_point(mesh, corners[contains], parent[contains], point)
        singular_groups.setdefault(grading, []).append(
            (pieces, piece_parent, np.tile(point, (len(piece_parent), 1)))
        )
        corners = corners[~contains]
        parent = parent[~contains]
    # the others: quartered as long as they are near a point, or larger than a kink allows
    finished: list[tuple[Array, Index]] = []
    for level in range(MAX_PIECE_QUARTERINGS):
        centre, radius = _piece_circles(mesh, corners, parent)
        marked = np.zeros(len(parent), dtype=bool)
        for point, _ in points:
            marked |= np.hypot(*(centre - point).T) < NEAR_IN_RADII * radius
        for kink in kinks:
            max_radius = (
                min(kink_piece_radius, KINK_PIECE_PER_RADIUS * kink.radius)
                if kink.radius
                else kink_piece_radius
            )
            is_coarse = radius > (0.0 if level < MIN_KINK_QUARTERINGS else max_radius)
            marked |= is_coarse & (np.abs(kink.signed_distances(centre)) < radius)
        # pieces not marked at level 0 are whole triangles, which need no splitting
        if level > 0:
            finished.append((corners[~marked], parent[~marked]))
        corners = quarter(corners[marked])
        parent = np.repeat(parent[marked], 4)
    finished.append((corners, parent))
    corners = np.concatenate([pieces for pieces, _ in finished])
    parent = np.concatenate([triangles for _, triangles in finished])
    singular = []
    for grading, groups in singular_groups.items():
        pieces, triangles, apex = map(np.concatenate, zip(*groups, strict=True))
        singular.append(SingularPieces(pieces, triangles, apex, grading))
    return corners, parent, singular


def _find_cut_triangles(mesh: Mesh, points: list[Array], kinks: list[Kink]) -> Index:
    """The triangles that a point is near or a kink may cross; no other one is ever cut."""
    centre, radius = mesh.enclosing_circles
    is_cut = np.zeros(len(radius), dtype=bool)
    for point in points:
        is_cut |= np.hypot(*(centre - point).T) < NEAR_IN_RADII * radius
    for kink in kinks:
        is_cut |= np.abs(kink.signed_distances(centre)) < radius
    return np.flatnonzero(is_cut)


def _separate_singular_points(
    mesh: Mesh, corners: Array, parent: Index, points: list[Array]
) -> tuple[Array, Index]:
    """Pieces quartered until those that contain a point have no other one near."""
    for _ in range(MAX_PIECE_QUARTERINGS):
        centre, radius = _piece_circles(mesh, corners, parent)
        contained = np.zeros(len(parent), dtype=np.intp)
        near_points = np.zeros(len(parent), dtype=np.intp)
        for point in points:
            near = np.flatnonzero(np.hypot(*(centre - point).T) < NEAR_IN_RADII * radius)
            near_points[near] += 1
            contained[near] += _pieces_contain(mesh, corners[near], parent[near], point)
        crowded = (contained > 0) & (near_points > 1)
        if not crowded.any():
            break
        corners = np.concatenate([corners[~crowded], quarter(corners[crowded])])
        parent = np.concatenate([parent[~crowded], np.repeat(parent[crowded], 4)])
    return corners, parent


def _piece_corners(mesh: Mesh, corners: Array, parent: Index) -> Array:
    """The corners (k, 3, 2) of the pieces in the plane."""
    return corners @ mesh.points[mesh.triangles[parent]]


def _piece_circles(mesh: Mesh, corners: Array, parent: Index) -> tuple[Array, Array]:
    """Centroid (k, 2) and the largest distance (k,) of a corner from it."""
    return centroid_circles(_piece_corners(mesh, corners, parent))


def _barycentric_in_pieces(mesh: Mesh, corners: Array, parent: Index, point: Array) -> Array:
    """The barycentric coordinates of a point of the plane in each piece; shape (k, 3)."""
    a, b, c = np.moveaxis(_piece_corners(mesh, corners, parent) - point, 1, 0)
    # a coordinate is the area of the triangle of the point and the opposite edge, over that of the piece
    areas = np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=-1)
    return areas / areas.sum(axis=1, keepdims=True)


def _pieces_contain(mesh: Mesh, corners: Array, parent: Index, point: Array) -> Mask:
    """Whether each piece contains the point, up to rounding."""
    return np.all(_barycentric_in_pieces(mesh, corners, parent, point) > -BARYCENTRIC_TOLERANCE, axis=1)


def _split_at_point(mesh: Mesh, corners: Array, parent: Index, point: Array) -> tuple[Array, Index]:
    """Up to three parts of each piece, which join the point to an edge; the point is their first corner."""
    weights = _barycentric_in_pieces(mesh, corners, parent, point)
    apex = (weights[:, None] @ corners)[:, 0]
    pieces = [np.stack([apex, corners[:, i], corners[:, (i + 1) % 3]], axis=1) for i in range(3)]
    proper = [weights[:, (i + 2) % 3] > BARYCENTRIC_TOLERANCE for i in range(3)]
    return (
        np.concatenate([piece[keep] for piece, keep in zip(pieces, proper, strict=True)]),
        np.concatenate([parent[keep] for keep in proper]),
    )


def quarter(corners: Array) -> Array:
    """The four congruent quarters of each piece; shape (4k, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab = 0.5 * (a + b)
    bc = 0.5 * (b + c)
    ca = 0.5 * (c + a)
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(vertices, axis=1) for vertices in quarters], axis=1).reshape(-1, 3, 3)
