"""Triangles cut into pieces on which a case's solution is smooth enough for a quadrature rule.

Pieces are triangles given by the barycentric coordinates of their corners in a triangle of the mesh. Pieces
that a kink crosses are quartered at least MIN_KINK_QUARTERINGS times, and until they are smaller than
KINK_PIECE_PER_SIDE of the shortest side (no side counts as shorter than MIN_SIDE_RATIO of the longest) and
than KINK_PIECE_PER_RADIUS of a circle's radius. Towards a singular point pieces are quartered until they are
small against their distance from it; the piece that contains the point is split there into pieces that have
it as their first corner, after it is small against the distance of other points.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

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


class Pieces(NamedTuple):
    """Pieces of the triangles `parent` (k,), by the barycentric coordinates `corners` (k, 3, 3) there."""

    corners: Array
    parent: Index

    def select(self, chosen: Mask | Index) -> Pieces:
        """The chosen pieces."""
        return Pieces(self.corners[chosen], self.parent[chosen])

    def quarter(self) -> Pieces:
        """The four congruent quarters of each piece."""
        return Pieces(quarter(self.corners), np.repeat(self.parent, 4))

    def vertices(self, mesh: Mesh) -> Array:
        """The corners in the plane; shape (k, 3, 2)."""
        return self.corners @ mesh.points[mesh.triangles[self.parent]]

    def barycentric(self, mesh: Mesh, point: Array) -> Array:
        """The barycentric coordinates of a point of the plane in each piece; shape (k, 3)."""
        a, b, c = np.moveaxis(self.vertices(mesh) - point, 1, 0)
        # a coordinate is the area of the triangle of the point and the opposite edge, over that of the piece
        areas = np.stack([cross(b, c), cross(c, a), cross(a, b)], axis=-1)
        return areas / areas.sum(axis=1, keepdims=True)

    def contain(self, mesh: Mesh, point: Array) -> Mask:
        """Whether each piece contains the point, up to rounding; shape (k,)."""
        return np.all(self.barycentric(mesh, point) > -BARYCENTRIC_TOLERANCE, axis=1)


class SingularPieces(NamedTuple):
    """Pieces whose first corner is a singular `point` (k, 2), which has that `grading`."""

    pieces: Pieces
    point: Array
    grading: int


def split_triangles(mesh: Mesh, case: ExactSolution) -> tuple[Array, Index, list[SingularPieces]]:
    """The pieces of all triangles that a kink crosses or that lie at a singular point of the case.

    They are given by their corners (k, 3, 3) in the triangles (k,); those at singular points stand apart, for
    each grading. Every triangle that occurs is covered once; those that do not occur need no splitting.
    """
    gradings = [p.grading for p in case.flux_singular_points()]
    points = [case.polygon.point(p.side, p.t) for p in case.flux_singular_points()]
    # whole triangles that a point is near or a kink may cross; no other one is ever cut
    any_size = [0.0] * len(case.kinks())
    cut = np.flatnonzero(_need_quartering(*mesh.enclosing_circles, points, case.kinks(), any_size))
    pieces = Pieces(np.broadcast_to(np.eye(3), (len(cut), 3, 3)), cut)
    pieces = _separate_singular_points(mesh, pieces, points)
    pieces, singular = _extract_singular_pieces(mesh, pieces, points, gradings)
    corners, parent = _quarter_near(mesh, case, pieces, points)
    return corners, parent, singular


def _separate_singular_points(mesh: Mesh, pieces: Pieces, points: list[Array]) -> Pieces:
    """Pieces quartered until those that contain a point have no other one near."""
    for _ in range(MAX_PIECE_QUARTERINGS):
        centre, radius = centroid_circles(pieces.vertices(mesh))
        contained = np.zeros(len(radius), dtype=np.intp)
        near_points = np.zeros(len(radius), dtype=np.intp)
        for point in points:
            near = np.flatnonzero(np.hypot(*(centre - point).T) < NEAR_IN_RADII * radius)
            near_points[near] += 1
            contained[near] += pieces.select(near).contain(mesh, point)
        crowded = (contained > 0) & (near_points > 1)
        if not crowded.any():
            break
        pieces = _join([pieces.select(~crowded), pieces.select(crowded).quarter()])
    return pieces


def _extract_singular_pieces(
    mesh: Mesh, pieces: Pieces, points: list[Array], gradings: list[int]
) -> tuple[Pieces, list[SingularPieces]]:
    """The pieces without those that contain a point, and what these are split into, for each grading.

    No piece contains two points, as `_separate_singular_points` leaves them.
    """
    groups: dict[int, list[tuple[Pieces, Array]]] = {}
    for point, grading in zip(points, gradings, strict=True):
        contains = pieces.contain(mesh, point)
        sub_pieces = _split_at_point(mesh, pieces.select(contains), point)
        groups.setdefault(grading, []).append((sub_pieces, np.tile(point, (len(sub_pieces.parent), 1))))
        pieces = pieces.select(~contains)
    singular = []
    for grading, group in groups.items():
        apex = np.concatenate([point for _, point in group])
        singular.append(SingularPieces(_join([sub_pieces for sub_pieces, _ in group]), apex, grading))
    return pieces, singular


def _split_at_point(mesh: Mesh, pieces: Pieces, point: Array) -> Pieces:
    """Up to three parts of each piece, which join the point to an edge; the point is their first corner."""
    weights = pieces.barycentric(mesh, point)
    apex = (weights[:, None] @ pieces.corners)[:, 0]
    sub_pieces = []
    for i in range(3):
        # the part at the edge from corner i to i + 1 has no area if the point lies on that edge
        proper = weights[:, (i + 2) % 3] > BARYCENTRIC_TOLERANCE
        corners = np.stack([apex, pieces.corners[:, i], pieces.corners[:, (i + 1) % 3]], axis=1)
        sub_pieces.append(Pieces(corners, pieces.parent).select(proper))
    return _join(sub_pieces)


def _quarter_near(mesh: Mesh, case: ExactSolution, pieces: Pieces, points: list[Array]) -> Pieces:
    """The pieces, quartered as long as they are near a point, or larger than a kink allows.

    They contain no point, so that they become small against their distance from it.
    """
    lengths = case.polygon.lengths
    kinks = case.kinks()
    line_radius = KINK_PIECE_PER_SIDE * max(lengths.min(), MIN_SIDE_RATIO * lengths.max())
    kink_radii = [  # a line has the radius 0
        min(line_radius, KINK_PIECE_PER_RADIUS * kink.radius) if kink.radius else line_radius
        for kink in kinks
    ]
    finished: list[Pieces] = []
    for level in range(MAX_PIECE_QUARTERINGS):
        max_radii = [0.0] * len(kinks) if level < MIN_KINK_QUARTERINGS else kink_radii
        marked = _need_quartering(*centroid_circles(pieces.vertices(mesh)), points, kinks, max_radii)
        # pieces not marked at level 0 are whole triangles, which need no splitting
        if level > 0:
            finished.append(pieces.select(~marked))
        pieces = pieces.select(marked).quarter()
    # what is still marked stays as it is
    return _join([*finished, pieces])


def _need_quartering(
    centre: Array, radius: Array, points: list[Array], kinks: list[Kink], max_radii: list[float]
) -> Mask:
    """Whether a point is near each piece, or a kink may cross it and its radius is above the kink's maximum.

    The circle of that `centre` (k, 2) and `radius` (k,) contains the piece.
    """
    marked = np.zeros(len(radius), dtype=bool)
    for point in points:
        marked |= np.hypot(*(centre - point).T) < NEAR_IN_RADII * radius
    for kink, max_radius in zip(kinks, max_radii, strict=True):
        marked |= (radius > max_radius) & (np.abs(kink.signed_distances(centre)) < radius)
    return marked


def _join(groups: list[Pieces]) -> Pieces:
    """All pieces of some groups."""
    corners = np.concatenate([pieces.corners for pieces in groups])
    return Pieces(corners, np.concatenate([pieces.parent for pieces in groups]))


def quarter(corners: Array) -> Array:
    """The four congruent quarters of each piece; shape (4k, 3, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab = 0.5 * (a + b)
    bc = 0.5 * (b + c)
    ca = 0.5 * (c + a)
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(vertices, axis=1) for vertices in quarters], axis=1).reshape(-1, 3, 3)
