"""Pieces of triangles cut along the lines and circles at which steps pos(a, 0) jump.

A circle is cut along chords. Between a chord and its arc a step does not have the value that it has in the
rest of the piece; the area in between is known.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.formulas.expression import Atom
from unilateral.formulas.taylor import EPS
from unilateral.geometry.curves import Kink
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross

TINY = 1e-300
"""A part of a triangle is left out if its share of the area is at most this: times an area it underflows."""
SMALL = 1 / 8
"""A piece is cut along a chord of a circle if its diameter is at most this times the radius."""
Jumps = Mapping[Atom, Kink]
Steps = dict[Atom, Array]


def cut(mesh: Mesh, corners: Array, parent: Index, jumps: Jumps) -> tuple[Array, Index]:
    """The pieces (k, 3, 3), cut along the curves, and the number (k,) of the piece that each is a part of.

    A piece that a curve crosses is cut in three by a chord. Pieces that are large against a circle are left
    whole. A part without an area, or nearly so, is left out: it is thinner than the rounding of coordinates,
    by which the boxes of its neighbours are wider (`source`).
    """
    owner = np.arange(len(parent))
    for kink in jumps.values():
        vertices = corners @ mesh.points[mesh.triangles[parent[owner]]]
        level = kink.level(vertices.reshape(-1, 2)).reshape(-1, 3)
        above = level >= 0
        crossed = above.any(axis=1) & ~above.all(axis=1) & _is_small(vertices, kink)
        corners, owner = _along(corners, owner, level, crossed)
    return corners, owner


def sides(vertices: Array, jumps: Jumps, size: float) -> tuple[dict[Atom, Array], dict[Atom, Array]]:
    """The value (k,) of every step on pieces, and the area (k,) on which it has the other value.

    The pieces have those vertices (k, 3, 2), computed from coordinates of that `size`. A value is NaN where
    the step may have both. The area is that of the part on the other side of the curve than the centroid, up
    to `rounding`; it is NaN for pieces that the curve is not near, and where the value is NaN.
    """
    steps, wrong, centre = {}, {}, vertices.mean(axis=1)
    for step, kink in jumps.items():
        level, reach = kink.level(centre), _diameter(vertices) + 64 * EPS * _size(size, kink)
        near, small = np.abs(level) <= reach, _is_small(vertices, kink)
        steps[step] = np.where(near & ~small, np.nan, kink.sign * level > 0)
        wrong[step] = np.where(
            near & small, _wrong_area(vertices, kink, steps[step] != (kink.sign > 0)), np.nan
        )
    return steps, wrong


def _is_small(vertices: Array, kink: Kink) -> Mask:
    return _diameter(vertices) <= (SMALL * kink.radius or np.inf)


def _diameter(vertices: Array) -> Array:
    return np.asarray(np.linalg.norm(vertices - np.roll(vertices, 1, axis=1), axis=2).max(axis=1))


def rounding(vertices: Array, kink: Kink, size: float) -> Array:
    """(k,) how far rounding may falsify the areas of `sides`, for coordinates of that size."""
    diameter = _diameter(vertices)
    return 64 * EPS * (_size(size, kink) * diameter + (kink.radius + diameter) ** 2)


def _size(size: float, kink: Kink) -> float:
    """The size of the numbers from which a kink's levels are computed."""
    return size + float(np.abs(kink.centre).max()) + kink.radius


def _wrong_area(vertices: Array, kink: Kink, inside: Mask) -> Array:
    """(k,) the area on which a step does not have the value that its piece is given.

    That is the value `inside` a circle or outside it. The area is 0 for a line, along which pieces are cut.
    """
    if not kink.radius:
        return np.zeros(len(vertices))
    disc = area_in_disc(vertices - np.array(kink.centre), kink.radius)
    area = 0.5 * np.abs(cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]))
    return np.clip(np.where(inside, area - disc, disc), 0.0, area)


def area_in_disc(vertices: Array, radius: float) -> Array:
    """(k,) the areas of triangles (k, 3, 2) in the disc about 0, from sectors and a triangle at each edge."""
    start, end = vertices, np.roll(vertices, -1, axis=1)
    d = end - start
    a, b, c = _dot(d, d), _dot(start, d), _dot(start, start) - radius**2
    root, a = np.sqrt(np.maximum(b**2 - a * c, 0.0)), np.where(a > 0, a, 1.0)
    t = (np.clip((-b + sign * root) / a, 0.0, 1.0)[..., None] for sign in (-1, 1))
    enter, leave = (start + fraction * d for fraction in t)
    sectors = _angle(start, enter) + _angle(leave, end)
    return np.abs(0.5 * (radius**2 * sectors + cross(enter, leave)).sum(axis=1))


def shares(corners: Array) -> Array:
    """(k,) the areas of pieces with barycentric corners (k, 3, 3), over those of their triangles."""
    b, c = ((corners[:, i] - corners[:, 0])[:, 1:] for i in (1, 2))
    return np.abs(cross(b, c))


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def _angle(a: Array, b: Array) -> Array:
    return np.asarray(np.arctan2(cross(a, b), _dot(a, b)))


def _along(corners: Array, owner: Index, level: Array, crossed: Mask) -> tuple[Array, Index]:
    """The pieces; each that is crossed is cut in three by the chord between two of its edges."""
    above, s = level[crossed] >= 0, level[crossed]
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners[crossed], order[..., None], axis=1), 1, 0)
    s = np.take_along_axis(s, order, axis=1)
    p, q = (a + (s[:, :1] / (s[:, :1] - s[:, [i]])) * (end - a) for i, end in ((1, b), (2, c)))
    pieces = [np.stack(piece, axis=1) for piece in ((a, p, q), (p, b, c), (p, c, q))]
    parts = np.concatenate(pieces)
    proper = shares(parts) > TINY
    of_parts = np.tile(owner[crossed], 3)[proper]
    return np.concatenate([corners[~crossed], parts[proper]]), np.concatenate([owner[~crossed], of_parts])
