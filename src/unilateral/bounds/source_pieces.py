"""Triangles and pieces of them on which f is a polynomial p, up to a bounded remainder and what jumps leave.

p has the degree ORDER. Its two variables sigma are (1, -1) and (-1, 1) at the ends of the longest edge, which
is opposite to a piece's first corner, and (-1, -1) at that corner.

Pieces are cut along the lines and circles at which steps pos(a, 0) jump, a circle along chords. Between a
chord and its arc a step does not have the value that it has in the rest of the piece; the area in between is
known.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask, blocks
from unilateral.fem.quadrature import collapsed
from unilateral.formulas.expression import Atom
from unilateral.formulas.taylor import EPS, Model, affine, basis
from unilateral.formulas.taylor_enclosures import Steps
from unilateral.geometry.curves import Kink, area_in_disc
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross
from unilateral.problems.problem import SourceFunction

ORDER = 4
ROUNDING = 4 * EPS
"""The rounding of the vertices of pieces, as a fraction of the size of coordinates."""
GAPS = 8.0
"""Gaps between pieces are at most as wide as this times EPS times the size of coordinates."""
TINY = 1e-300
"""A part of a triangle is left out if its share of the area is at most this: times an area it underflows."""
SMALL = 1 / 8
"""A piece is cut along a chord of a circle if its diameter is at most this times the radius."""
Jumps = Mapping[Atom, Kink]


class TrianglePieces(NamedTuple):
    """Triangles with barycentric corners (k, 3, 3) in the triangles `parent` (k,), and p's c (m, k) on them.

    f - p is the sum of a function with ||.||^2 <= `squares` (k,) and another one with ||.|| <= `jumping`
    (k,), whose integral is at most `integral` (k,). `outer` (k,) is a piece's area plus what may lie between
    it and its neighbours, whose corners are rounded differently.
    """

    c: Array
    corners: Array
    parent: Index
    area: Array
    outer: Array
    squares: Array
    jumping: Array
    integral: Array

    def of(self, kept: Mask) -> TrianglePieces:
        others = {name: getattr(self, name)[kept] for name in self._fields if name != "c"}
        return self._replace(c=self.c[:, kept], **others)


def rounded_size(mesh: Mesh) -> float:
    """ROUNDING times this is at least the rounding of coordinates and the nodes' `shift` together."""
    return float(np.abs(mesh.polygon.vertices).max() + mesh.shift.max() / ROUNDING)


def areas_of(mesh: Mesh, corners: Array, parent: Index) -> Array:
    return shares(corners) * mesh.areas[parent]


def known_at_points(mesh: Mesh, corners: Array, parent: Index, source: SourceFunction) -> Array:
    """(k,) what E^2 would be if f were known on all of a piece as well as in its middle.

    Smaller pieces would be in vain.
    """
    middle = corners.mean(axis=1, keepdims=True) @ mesh.points[mesh.triangles[parent]]
    known = []
    size = rounded_size(mesh)
    for block in blocks(len(parent)):
        vertices = np.repeat(middle[block], 3, axis=1)
        known.append(_known(_model(vertices, size, source, sides(vertices, source.jumps, size)[0])))
    return areas_of(mesh, corners, parent) * np.concatenate([np.zeros(0), *known]) ** 2


def polynomials(
    mesh: Mesh, corners: Array, parent: Index, source: SourceFunction
) -> tuple[TrianglePieces, Index]:
    """p on the pieces, where those at a jump are cut along it; the piece (k,) that each is a part of."""
    pieces = []
    owners = []
    for block in blocks(len(parent)):
        parts, owner = cut(mesh, corners[block], parent[block], source.jumps)
        pieces.append(on_block(mesh, parts, parent[block][owner], source))
        owners.append(owner + block.start)
    c, *others = zip(*pieces, strict=True)
    joined = TrianglePieces(np.concatenate(c, axis=1), *map(np.concatenate, others))
    return joined, np.concatenate(owners)


def with_gaps(area: Array, perimeter: Array, size: float) -> Array:
    """(k,) areas plus what may lie between pieces, for coordinates of that size."""
    return area + GAPS * EPS * size * perimeter


def on_triangles(vertices: Array, size: float, source: SourceFunction) -> tuple[Array, Array, Array]:
    """p's c (m, k) on triangles (k, 3, 2), a bound (k,) on |f - p|, and the vertices in the order for sigma.

    A step has both its values on a triangle that its curve may cross.
    """
    order, _ = _ordered(vertices)
    vertices = np.take_along_axis(vertices, order[..., None], axis=1)
    steps, wrong = sides(vertices, source.jumps, size)
    both = {step: np.where(np.isnan(wrong[step]), value, np.nan) for step, value in steps.items()}
    f = _model(vertices, size, source, both)
    return f.c, _known(f), vertices


def on_block(mesh: Mesh, corners: Array, parent: Index, source: SourceFunction) -> TrianglePieces:
    vertices = corners @ mesh.points[mesh.triangles[parent]]
    order, perimeter = _ordered(vertices)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    vertices = np.take_along_axis(vertices, order[..., None], axis=1)
    size = rounded_size(mesh)
    steps, wrong = sides(vertices, source.jumps, size)
    f = _model(vertices, size, source, steps)
    area = areas_of(mesh, corners, parent)
    outer = with_gaps(area, perimeter, size)
    squares = outer * _known(f) ** 2
    nothing = np.zeros((2, len(parent)))
    pieces = TrianglePieces(f.c, corners, parent, area, outer, squares, *nothing)
    near = {step: ~np.isnan(of_step) for step, of_step in wrong.items()}
    for step, at in near.items():
        here = {each: value[at] for each, value in steps.items()}
        by = _model(vertices[at], size, source, here | {step: 1 - here[step]}) + f.on(at).scaled(-1.0)
        _jump(pieces, at, by, wrong[step][at], rounding(vertices[at], source.jumps[step], size))
    several = np.sum([*near.values()], axis=0) > 1
    if several.any():
        _jumps(pieces, several, vertices[several], size, source, steps, wrong)
    return pieces


def _jump(pieces: TrianglePieces, at: Mask, by: Model, wrong: Array, doubt: Array) -> None:
    """Account for parts of the pieces `at` where f is larger `by` so much; their areas are `wrong` (k,).

    The areas are known up to `doubt` (k,). p is changed by a constant so that its integral is that of f.
    """
    # where f has no range on all of a piece, as 1/a where a may be 0, nothing is known of it there
    known = np.isfinite(by.range[0]) & np.isfinite(by.range[1])
    lower, upper = np.where(known, by.range, 0.0)
    middle = 0.5 * (lower + upper)
    most = np.maximum(np.abs(lower), np.abs(upper))
    area = pieces.area[at]
    shift = middle * wrong / area
    pieces.c[0, at] += shift
    jumping = most * np.sqrt(wrong + doubt) + np.abs(shift) * np.sqrt(area)
    integral = 0.5 * (upper - lower) * wrong + most * doubt
    pieces.jumping[at] += np.where(known, jumping, np.inf)
    pieces.integral[at] += np.where(known, integral, np.inf)


def _jumps(
    pieces: TrianglePieces,
    at: Mask,
    vertices: Array,
    size: float,
    source: SourceFunction,
    steps: Steps,
    wrong: Steps,
) -> None:
    """Account for places where several steps are wrong at once.

    f is off there by no more than all its values on the piece differ.
    """
    both = {step: np.where(np.isnan(wrong[step][at]), value[at], np.nan) for step, value in steps.items()}
    lower, upper = _model(vertices, size, source, both).range
    doubts = [rounding(vertices, kink, size) for kink in source.jumps.values()]
    areas = [np.nan_to_num(wrong[step][at]) + doubt for step, doubt in zip(wrong, doubts, strict=True)]
    second = np.sort(areas, axis=0)[-2]
    most = (1 + len(areas)) * (upper - lower)
    pieces.jumping[at] += most * np.sqrt(len(areas) * second)
    pieces.integral[at] += most * len(areas) * second


def _ordered(vertices: Array) -> tuple[Index, Array]:
    """(k, 3) the corners, the one opposite to the longest edge first, and the perimeters (k,)."""
    lengths = np.linalg.norm(vertices[:, [2, 0, 1]] - vertices[:, [1, 2, 0]], axis=2)
    return (np.argmax(lengths, axis=1)[:, None] + np.arange(3)) % 3, lengths.sum(axis=1)


def _model(vertices: Array, size: float, source: SourceFunction, steps: Steps) -> Model:
    """f on pieces with those vertices (k, 3, 2), which are rounded like coordinates of that `size`."""
    places = []
    off = ROUNDING * size
    for values in np.moveaxis(vertices, 2, 0):
        a, b, c = values.T
        ends = values.min(axis=1) - off, values.max(axis=1) + off
        places.append(affine(basis(2, ORDER), 0.5 * (b + c), 0.5 * np.stack([b - a, c - a]), ends, off))
    x, y = places
    return source.model(x, y, steps)


def _known(f: Model) -> Array:
    """(k,) a bound on |f - p|, which includes the rounding of p."""
    return np.asarray(f.rad + 32 * EPS * np.abs(f.c).sum(axis=0))


def cut(mesh: Mesh, corners: Array, parent: Index, jumps: Jumps) -> tuple[Array, Index]:
    """The pieces (k, 3, 3), cut along the curves, and the number (k,) of the piece that each is a part of.

    A piece that a curve crosses is cut in three by a chord. Pieces that are large against a circle are left
    whole. A part without an area, or nearly so, is left out: it is thinner than the rounding of coordinates,
    by which the boxes of its neighbours are wider.
    """
    owner = np.arange(len(parent))
    for kink in jumps.values():
        vertices = corners @ mesh.points[mesh.triangles[parent[owner]]]
        level = kink.level(vertices.reshape(-1, 2)).reshape(-1, 3)
        above = level >= 0
        crossed = above.any(axis=1) & ~above.all(axis=1) & _is_small(vertices, kink)
        corners, owner = _along(corners, owner, level, crossed)
    return corners, owner


def _along(corners: Array, owner: Index, level: Array, crossed: Mask) -> tuple[Array, Index]:
    """The pieces; each that is crossed is cut in three by the chord between two of its edges."""
    above = level[crossed] >= 0
    s = level[crossed]
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    order = (alone[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners[crossed], order[..., None], axis=1), 1, 0)
    s = np.take_along_axis(s, order, axis=1)
    p = a + (s[:, :1] / (s[:, :1] - s[:, [1]])) * (b - a)
    q = a + (s[:, :1] / (s[:, :1] - s[:, [2]])) * (c - a)
    parts = np.concatenate([np.stack(part, axis=1) for part in ((a, p, q), (p, b, c), (p, c, q))])
    proper = shares(parts) > TINY
    of_parts = np.tile(owner[crossed], 3)[proper]
    return np.concatenate([corners[~crossed], parts[proper]]), np.concatenate([owner[~crossed], of_parts])


def shares(corners: Array) -> Array:
    """(k,) the areas of pieces with barycentric corners (k, 3, 3), over those of their triangles."""
    b = (corners[:, 1] - corners[:, 0])[:, 1:]
    c = (corners[:, 2] - corners[:, 0])[:, 1:]
    return np.abs(cross(b, c))


def sides(vertices: Array, jumps: Jumps, size: float) -> tuple[dict[Atom, Array], dict[Atom, Array]]:
    """The value (k,) of every step on pieces, and the area (k,) on which it has the other value.

    The pieces have those vertices (k, 3, 2), computed from coordinates of that `size`. A value is NaN where
    the step may have both. The area is that of the part on the other side of the curve than the centroid, up
    to `rounding`; it is NaN for pieces that the curve is not near, and where the value is NaN.
    """
    steps = {}
    wrong = {}
    centre = vertices.mean(axis=1)
    for step, kink in jumps.items():
        level = kink.level(centre)
        reach = _diameter(vertices) + 64 * EPS * _size(size, kink)
        near = np.abs(level) <= reach
        small = _is_small(vertices, kink)
        steps[step] = np.where(near & ~small, np.nan, kink.sign * level > 0)
        area = _wrong_area(vertices, kink, steps[step] != (kink.sign > 0))
        wrong[step] = np.where(near & small, area, np.nan)
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


def averages(c: Array) -> Array:
    """(2, k) the means of p and of p^2, from the coefficients c (m, k) of p."""
    return np.stack([hat_means().sum(axis=0) @ c, np.sum((_triangular() @ c) ** 2, axis=0)])


@cache
def hat_means() -> Array:
    """(3, m) means of monomials times each hat."""
    (points, weights) = collapsed(ORDER + 1)
    values = _monomials()
    return (points.T * weights) @ values.T


def _monomials() -> Array:
    """(m, q) the values of the monomials at the points of the rule."""
    points, _ = collapsed(ORDER + 1)
    return np.prod((2 * points.T[1:] - 1) ** basis(2, ORDER).exponents[..., None], axis=1)


@cache
def _triangular() -> Array:
    """(m, m) R with |R c|^2 = mean p^2; degrees increase, so the rows from 3 on give p - f_h."""
    _, weights = collapsed(ORDER + 1)
    return np.asarray(np.linalg.qr((_monomials() * np.sqrt(weights)).T, mode="r"))
