"""Triangles and pieces of them on which f is a polynomial p, up to a bounded remainder and what jumps leave.

p has the degree SOURCE_DEGREE. Its two variables sigma are (1, -1) and (-1, 1) at the ends of the longest
edge, which is opposite to a piece's first corner, and (-1, -1) at that corner.

Pieces are cut along the lines and circles at which steps pos(a, 0) jump, a circle along chords. Between a
chord and its arc a step does not have the value that it has in the rest of the piece; the area in between is
known.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.fem.quadrature import duffy_rule
from unilateral.formulas.expression import Primitive
from unilateral.formulas.taylor import EPS, TaylorModel, affine_model, monomial_basis
from unilateral.formulas.taylor_enclosures import StepValues
from unilateral.geometry.curves import Kink, area_in_disc
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import cross
from unilateral.problems.problem import SourceFunction

SOURCE_DEGREE = 4
VERTEX_ROUNDING = 4 * EPS
"""The rounding of the vertices of pieces, as a fraction of the size of coordinates."""
MAX_GAP_WIDTH = 8.0
"""Gaps between pieces are at most as wide as this times EPS times the size of coordinates."""
MIN_AREA_SHARE = 1e-300
"""A part of a triangle is left out if its share of the area is at most this: times an area it underflows."""
MAX_DIAMETER_PER_RADIUS = 1 / 8
"""A piece is cut along a chord of a circle if its diameter is at most this times the radius."""
Jumps = Mapping[Primitive, Kink]


class TrianglePieces(NamedTuple):
    """Triangles with barycentric corners (k, 3, 3) in the triangles `parent` (k,), and p's c (m, k) on them.

    f - p is the sum of a function with ||.||^2 <= `remainder_squares` (k,) and another one with ||.|| <=
    `jump_norm` (k,), whose integral is at most `jump_integral` (k,). `outer_area` (k,) is a piece's area plus
    what may lie between it and its neighbours, whose corners are rounded differently.
    """

    c: Array
    corners: Array
    parent: Index
    area: Array
    outer_area: Array
    remainder_squares: Array
    jump_norm: Array
    jump_integral: Array

    def select(self, selection: Mask) -> TrianglePieces:
        """Some of the pieces."""
        fields = {name: getattr(self, name)[selection] for name in self._fields if name != "c"}
        return self._replace(c=self.c[:, selection], **fields)


class Steps(NamedTuple):
    """The value (k,) of every step `at_centroid` of each piece; NaN if the piece is large and may have both.

    `wrong_areas` (k,) are those of the parts beyond the curve, where the step has the other value, up to
    `step_area_rounding`. They are NaN for pieces that the curve is not near, and where the value is NaN.
    """

    at_centroid: dict[Primitive, Array]
    wrong_areas: dict[Primitive, Array]

    @property
    def widened(self) -> dict[Primitive, Array]:
        """The steps with both values, NaN, on all pieces near their curves."""
        is_far = {step: np.isnan(area) for step, area in self.wrong_areas.items()}
        return {step: np.where(is_far[step], value, np.nan) for step, value in self.at_centroid.items()}


def coordinate_scale(mesh: Mesh) -> float:
    """VERTEX_ROUNDING times this is at least the rounding of coordinates and the nodes' shifts together."""
    return float(np.abs(mesh.polygon.vertices).max() + mesh.node_shifts.max() / VERTEX_ROUNDING)


def piece_areas(mesh: Mesh, corners: Array, parent: Index) -> Array:
    """The area of each piece, from its corners in its triangle."""
    return area_shares(corners) * mesh.areas[parent]


def attainable_squares(mesh: Mesh, corners: Array, parent: Index, f: SourceFunction) -> Array:
    """The E^2 that each piece would have if f were known on all of it as well as in its middle, (k,).

    Smaller pieces would be in vain.
    """
    middle = corners.mean(axis=1, keepdims=True) @ mesh.points[mesh.triangles[parent]]
    remainders = []
    size = coordinate_scale(mesh)
    for block in row_blocks(len(parent)):
        vertices = np.repeat(middle[block], 3, axis=1)  # a piece that is shrunk to its middle
        steps = step_values(vertices, f.jumps, size)
        remainders.append(_remainder_bound(_taylor_model(vertices, size, f, steps.at_centroid)))
    return piece_areas(mesh, corners, parent) * np.concatenate([np.zeros(0), *remainders]) ** 2


def enclose_pieces(
    mesh: Mesh, corners: Array, parent: Index, f: SourceFunction
) -> tuple[TrianglePieces, Index]:
    """p on pieces with `corners` in triangles `parent`, cut at jumps; the piece that each is a part of."""
    pieces = []
    owners = []
    for block in row_blocks(len(parent)):
        split_corners, owner = split_at_jumps(mesh, corners[block], parent[block], f.jumps)
        pieces.append(enclose_block(mesh, split_corners, parent[block][owner], f))
        owners.append(owner + block.start)
    # c has the pieces on its last axis, the other fields on the first
    c, *fields = zip(*pieces, strict=True)
    joined = TrianglePieces(np.concatenate(c, axis=1), *map(np.concatenate, fields))
    return joined, np.concatenate(owners)


def widen_areas(area: Array, perimeter: Array, scale: float) -> Array:
    """The areas (k,) of pieces plus gaps along their perimeters, for coordinates of that `scale`."""
    return area + MAX_GAP_WIDTH * EPS * scale * perimeter


def enclose_triangles(vertices: Array, scale: float, f: SourceFunction) -> tuple[Array, Array, Array]:
    """p's c (m, k) on triangles (k, 3, 2), a bound (k,) on |f - p|, and the vertices in order for sigma."""
    order, _ = _order_corners(vertices)
    vertices = np.take_along_axis(vertices, order[..., None], axis=1)
    steps = step_values(vertices, f.jumps, scale)
    # these triangles are not cut: a step has both its values where its curve may cross
    model = _taylor_model(vertices, scale, f, steps.widened)
    return model.c, _remainder_bound(model), vertices


def enclose_block(mesh: Mesh, corners: Array, parent: Index, f: SourceFunction) -> TrianglePieces:
    """p on a block of pieces, and bounds on f - p, jumps included."""
    vertices = corners @ mesh.points[mesh.triangles[parent]]
    order, perimeter = _order_corners(vertices)
    corners = np.take_along_axis(corners, order[..., None], axis=1)
    vertices = np.take_along_axis(vertices, order[..., None], axis=1)
    size = coordinate_scale(mesh)
    steps = step_values(vertices, f.jumps, size)
    model = _taylor_model(vertices, size, f, steps.at_centroid)
    area = piece_areas(mesh, corners, parent)
    outer = widen_areas(area, perimeter, size)
    pieces = TrianglePieces(
        c=model.c,
        corners=corners,
        parent=parent,
        area=area,
        outer_area=outer,
        remainder_squares=outer * _remainder_bound(model) ** 2,
        jump_norm=np.zeros(len(parent)),
        jump_integral=np.zeros(len(parent)),
    )
    _add_jumps(pieces, vertices, size, f, model, steps)
    return pieces


def _add_jumps(
    pieces: TrianglePieces, vertices: Array, scale: float, f: SourceFunction, model: TaylorModel, steps: Steps
) -> None:
    """Account for jumps on pieces, in place; `model` has p, with the values of `steps` on most of each."""
    # between a chord and its arc f has the other value of the step, and is larger by the jump
    near = {step: ~np.isnan(wrong_area) for step, wrong_area in steps.wrong_areas.items()}
    for step, is_near in near.items():
        near_values = {other_step: value[is_near] for other_step, value in steps.at_centroid.items()}
        near_values[step] = 1 - near_values[step]
        model_beyond = _taylor_model(vertices[is_near], scale, f, near_values)
        _add_jump(
            pieces,
            is_near,
            jump=model_beyond + model.select_boxes(is_near).scale(-1.0),
            wrong_area=steps.wrong_areas[step][is_near],
            area_error=step_area_rounding(vertices[is_near], f.jumps[step], scale),
        )
    is_crossed = np.sum([*near.values()], axis=0) > 1
    if is_crossed.any():
        _add_crossing_jumps(pieces, is_crossed, vertices, scale, f, steps)


def _add_jump(
    pieces: TrianglePieces, selection: Mask, jump: TaylorModel, wrong_area: Array, area_error: Array
) -> None:
    """Account for the parts of the pieces `selection` on which f is larger by a `jump`, in place.

    Their areas are `wrong_area` (k,) up to `area_error` (k,). p is raised by a constant, so that its integral
    is that of f.
    """
    # where f has no range on all of a piece, as 1/a where a may be 0, nothing is known of it there
    is_bounded = np.isfinite(jump.range[0]) & np.isfinite(jump.range[1])
    lower, upper = np.where(is_bounded, jump.range, 0.0)
    jump_mean = 0.5 * (lower + upper)
    largest = np.maximum(np.abs(lower), np.abs(upper))
    area = pieces.area[selection]
    # p + shift has the integral of f, if the jump is its middle value and the area is right
    shift = jump_mean * wrong_area / area
    pieces.c[0, selection] += shift
    # ||jump|| on the part and ||shift|| on the piece; the integral is off by what jump and area are off
    jump_norm = largest * np.sqrt(wrong_area + area_error) + np.abs(shift) * np.sqrt(area)
    integral = 0.5 * (upper - lower) * wrong_area + largest * area_error
    pieces.jump_norm[selection] += np.where(is_bounded, jump_norm, np.inf)
    pieces.jump_integral[selection] += np.where(is_bounded, integral, np.inf)


def _add_crossing_jumps(
    pieces: TrianglePieces, selection: Mask, vertices: Array, scale: float, f: SourceFunction, steps: Steps
) -> None:
    """Account for places, on the pieces `selection`, where several steps are wrong at once, in place."""
    vertices = vertices[selection]
    widened = {step: value[selection] for step, value in steps.widened.items()}
    lower, upper = _taylor_model(vertices, scale, f, widened).range
    # NaN: the curve is not near, or f was enclosed with both values. Then no area is wrong
    areas = [
        np.nan_to_num(steps.wrong_areas[step][selection]) + step_area_rounding(vertices, kink, scale)
        for step, kink in f.jumps.items()
    ]
    # one of two steps that are wrong at once has at most the second largest area
    second = np.sort(areas, axis=0)[-2]
    # f is off by at most upper - lower there, and so is the jump that `_add_jump` allowed for of each step
    largest = (1 + len(areas)) * (upper - lower)
    pieces.jump_norm[selection] += largest * np.sqrt(len(areas) * second)
    pieces.jump_integral[selection] += largest * len(areas) * second


def _order_corners(vertices: Array) -> tuple[Index, Array]:
    """The order (k, 3) of corners in which that opposite to the longest edge is first, and the perimeters."""
    lengths = np.linalg.norm(vertices[:, [2, 0, 1]] - vertices[:, [1, 2, 0]], axis=2)
    return (np.argmax(lengths, axis=1)[:, None] + np.arange(3)) % 3, lengths.sum(axis=1)


def _taylor_model(vertices: Array, scale: float, f: SourceFunction, steps: StepValues) -> TaylorModel:
    """f on pieces (k, 3, 2) with rounded coordinates of that `scale`; NaN in `steps` means both values."""
    places = []
    basis = monomial_basis(2, SOURCE_DEGREE)
    rounding = VERTEX_ROUNDING * scale
    for values in np.moveaxis(vertices, 2, 0):
        a, b, c = values.T
        ends = values.min(axis=1) - rounding, values.max(axis=1) + rounding
        # (b + c) / 2 + sigma_1 (b - a) / 2 + sigma_2 (c - a) / 2 is a at (-1, -1), b at (1, -1), c at (-1, 1)
        half_widths = 0.5 * np.stack([b - a, c - a])
        places.append(affine_model(basis, 0.5 * (b + c), half_widths, ends, rounding))
    x, y = places
    return f.model(x, y, steps)


def _remainder_bound(model: TaylorModel) -> Array:
    """A bound on |f - p| on each piece, which includes the rounding of p, (k,)."""
    return np.asarray(model.rad + 32 * EPS * np.abs(model.c).sum(axis=0))


def split_at_jumps(mesh: Mesh, corners: Array, parent: Index, jumps: Jumps) -> tuple[Array, Index]:
    """The pieces (k, 3, 3), cut along the curves, and the number (k,) of the piece that each is a part of.

    A piece that a curve crosses is cut in three by a chord. Pieces that are large against a circle are left
    whole. A part without an area, or nearly so, is left out: it is thinner than the rounding of coordinates,
    by which the boxes of its neighbours are wider.
    """
    owner = np.arange(len(parent))
    for kink in jumps.values():
        vertices = corners @ mesh.points[mesh.triangles[parent[owner]]]
        level = kink.signed_distances(vertices.reshape(-1, 2)).reshape(-1, 3)
        above = level >= 0
        crossed = above.any(axis=1) & ~above.all(axis=1) & _is_small(vertices, kink)
        corners, owner = _split_by_chords(corners, owner, level, crossed)
    return corners, owner


def _split_by_chords(corners: Array, owner: Index, level: Array, crossed: Mask) -> tuple[Array, Index]:
    """The pieces and the `owner` of each; where `crossed` by {level = 0} they are cut in three by a chord."""
    s = level[crossed]
    above = s >= 0
    # the corner that lies alone on one side of the curve: above if one is, below if two are above
    apex = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    order = (apex[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(corners[crossed], order[..., None], axis=1), 1, 0)
    s = np.take_along_axis(s, order, axis=1)
    # the signed distance s, taken for linear along edges, is 0 at p and q
    p = a + (s[:, :1] / (s[:, :1] - s[:, [1]])) * (b - a)
    q = a + (s[:, :1] / (s[:, :1] - s[:, [2]])) * (c - a)
    thirds = np.concatenate(
        [np.stack(corner_points, axis=1) for corner_points in ((a, p, q), (p, b, c), (p, c, q))]
    )
    proper = area_shares(thirds) > MIN_AREA_SHARE
    part_owner = np.tile(owner[crossed], 3)[proper]
    return np.concatenate([corners[~crossed], thirds[proper]]), np.concatenate([owner[~crossed], part_owner])


def area_shares(corners: Array) -> Array:
    """The areas of pieces over those of their triangles, (k,), from barycentric `corners` (k, 3, 3)."""
    b = (corners[:, 1] - corners[:, 0])[:, 1:]
    c = (corners[:, 2] - corners[:, 0])[:, 1:]
    return np.abs(cross(b, c))


def step_values(vertices: Array, jumps: Jumps, scale: float) -> Steps:
    """The `Steps` on pieces with those vertices (k, 3, 2), computed from coordinates of that `scale`."""
    at_centroid = {}
    wrong_areas = {}
    centre = vertices.mean(axis=1)
    for step, kink in jumps.items():
        level = kink.signed_distances(centre)
        # no point of a piece is farther from the centroid than the diameter
        reach = _diameter(vertices) + 64 * EPS * _level_scale(scale, kink)
        near = np.abs(level) <= reach
        small = _is_small(vertices, kink)
        at_centroid[step] = np.where(near & ~small, np.nan, kink.sign * level > 0)
        # a step is 1 where sign times the level is positive, and the level is negative inside a circle
        area = _wrong_area(vertices, kink, at_centroid[step] != (kink.sign > 0))
        wrong_areas[step] = np.where(near & small, area, np.nan)
    return Steps(at_centroid, wrong_areas)


def _is_small(vertices: Array, kink: Kink) -> Mask:
    """Whether pieces are small against a circle; against a line all are."""
    return _diameter(vertices) <= (MAX_DIAMETER_PER_RADIUS * kink.radius or np.inf)


def _diameter(vertices: Array) -> Array:
    return np.asarray(np.linalg.norm(vertices - np.roll(vertices, 1, axis=1), axis=2).max(axis=1))


def step_area_rounding(vertices: Array, kink: Kink, scale: float) -> Array:
    """How far rounding may falsify the areas of `step_values`, (k,)."""
    diameter = _diameter(vertices)
    return 64 * EPS * (_level_scale(scale, kink) * diameter + (kink.radius + diameter) ** 2)


def _level_scale(scale: float, kink: Kink) -> float:
    """The size of the numbers from which a kink's levels are computed."""
    return scale + float(np.abs(kink.centre).max()) + kink.radius


def _wrong_area(vertices: Array, kink: Kink, inside: Mask) -> Array:
    """The area on which a step does not have the value that its piece is given, (k,).

    That is the value `inside` a circle or outside it. The area is 0 for a line, along which pieces are cut.
    """
    if not kink.radius:
        return np.zeros(len(vertices))
    disc = area_in_disc(vertices - np.array(kink.centre), kink.radius)
    area = 0.5 * np.abs(cross(vertices[:, 1] - vertices[:, 0], vertices[:, 2] - vertices[:, 0]))
    return np.clip(np.where(inside, area - disc, disc), 0.0, area)


def polynomial_means(c: Array) -> Array:
    """The means of p and of p^2 on each piece, from the coefficients of p, (2, k)."""
    return np.stack([hat_means().sum(axis=0) @ c, np.sum((_mean_square_factor() @ c) ** 2, axis=0)])


@cache
def hat_means() -> Array:
    """The means over a triangle of the monomials times each hat, (3, m)."""
    points, weights = duffy_rule(SOURCE_DEGREE + 1)
    values = _monomial_values()
    return (points.T * weights) @ values.T


def _monomial_values() -> Array:
    """The values of the monomials at the points of the rule, (m, q)."""
    points, _ = duffy_rule(SOURCE_DEGREE + 1)
    return np.prod((2 * points.T[1:] - 1) ** monomial_basis(2, SOURCE_DEGREE).exponents[..., None], axis=1)


@cache
def _mean_square_factor() -> Array:
    """The triangular matrix R with |R c|^2 = mean p^2; its rows from 3 on give p - f_h, (m, m)."""
    # QR of the values at the rule's points: |R c|^2 = |Q R c|^2; the first three monomials are linear
    _, weights = duffy_rule(SOURCE_DEGREE + 1)
    return np.asarray(np.linalg.qr((_monomial_values() * np.sqrt(weights)).T, mode="r"))
