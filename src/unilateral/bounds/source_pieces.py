"""Triangles and pieces of them on which f is a polynomial, up to a bounded remainder and what jumps leave."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index, Mask, blocks
from unilateral.bounds.polynomial_means import ORDER
from unilateral.bounds.source_jumps import cut, rounding, shares, sides
from unilateral.formulas.taylor import EPS, Model, affine, basis
from unilateral.formulas.taylor_functions import Steps
from unilateral.geometry.mesh import Mesh
from unilateral.problems.data import Data

ROUNDING = 4 * EPS
"""The rounding of the vertices of pieces, as a fraction of the size of coordinates."""
GAPS = 8.0
"""Gaps between pieces are at most as wide as this times EPS times the size of coordinates."""


class TrianglePieces(NamedTuple):
    """Triangles with barycentric corners (k, 3, 3) in the triangles `parent` (k,), and p's c (m, k) on them.

    The longest edge lies opposite to the first corner. The two variables of p are (1, -1) and (-1, 1) at the
    ends of that edge and (-1, -1) at that corner. f - p is the sum of a function with ||.||^2 <= `squares`
    (k,) and another one with ||.|| <= `jumping` (k,), whose integral is at most `integral` (k,). `outer` (k,)
    is a piece's area plus what may lie between it and its neighbours, whose corners are rounded differently.
    """

    corners: Array
    parent: Index
    outer: Array
    c: Array
    squares: Array
    jumping: Array
    integral: Array

    def of(self, kept: Mask) -> TrianglePieces:
        rest = (self.squares[kept], self.jumping[kept], self.integral[kept])
        return TrianglePieces(self.corners[kept], self.parent[kept], self.outer[kept], self.c[:, kept], *rest)


def rounded_size(mesh: Mesh) -> float:
    """ROUNDING times this is at least the rounding of coordinates and the nodes' `shift` together."""
    return float(np.abs(mesh.polygon.vertices).max() + mesh.shift.max() / ROUNDING)


def areas_of(mesh: Mesh, corners: Array, parent: Index) -> Array:
    return shares(corners) * mesh.areas[parent]


def areas(mesh: Mesh, pieces: TrianglePieces) -> Array:
    return areas_of(mesh, pieces.corners, pieces.parent)


def known_at_points(mesh: Mesh, corners: Array, parent: Index, data: Data) -> Array:
    """(k,) what E^2 would be if f were known on all of a piece as well as in its middle.

    Smaller pieces would be in vain.
    """
    middle = corners.mean(axis=1, keepdims=True) @ mesh.points[mesh.triangles[parent]]
    known, size = [], rounded_size(mesh)
    for block in blocks(len(parent)):
        vertices = np.repeat(middle[block], 3, axis=1)
        known.append(_known(_model(vertices, size, data, sides(vertices, data.jumps, size)[0])))
    return areas_of(mesh, corners, parent) * np.concatenate([np.zeros(0), *known]) ** 2


def polynomials(mesh: Mesh, corners: Array, parent: Index, data: Data) -> tuple[TrianglePieces, Index]:
    """p on the pieces, where those at a jump are cut along it; the piece (k,) that each is a part of."""
    found, owners = [], []
    for block in blocks(len(parent)):
        parts, owner = cut(mesh, corners[block], parent[block], data.jumps)
        found.append(on_block(mesh, parts, parent[block][owner], data))
        owners.append(owner + block.start)
    along = (0, 0, 0, 1, 0, 0, 0)
    fields = zip(zip(*found, strict=True), along, strict=True)
    return TrianglePieces(*(np.concatenate(each, axis=axis) for each, axis in fields)), np.concatenate(owners)


def with_gaps(area: Array, perimeter: Array, size: float) -> Array:
    """(k,) areas plus what may lie between pieces, for coordinates of that size."""
    return area + GAPS * EPS * size * perimeter


def on_triangles(vertices: Array, size: float, data: Data) -> tuple[Array, Array, Index]:
    """p's c (m, k) on triangles (k, 3, 2), a bound (k,) on |f - p|, and the corner (k,) that comes first.

    A step has both its values on a triangle that its curve may cross.
    """
    order, _ = _ordered(vertices)
    vertices = np.take_along_axis(vertices, order[..., None], axis=1)
    steps, wrong = sides(vertices, data.jumps, size)
    f = _model(
        vertices, size, data, {step: np.where(np.isnan(wrong[step]), steps[step], np.nan) for step in steps}
    )
    return f.c, _known(f), order[:, 0]


def on_block(mesh: Mesh, corners: Array, parent: Index, data: Data) -> TrianglePieces:
    vertices = corners @ mesh.points[mesh.triangles[parent]]
    order, perimeter = _ordered(vertices)
    corners, vertices = (np.take_along_axis(a, order[..., None], axis=1) for a in (corners, vertices))
    size = rounded_size(mesh)
    steps, wrong = sides(vertices, data.jumps, size)
    f, area = _model(vertices, size, data, steps), areas_of(mesh, corners, parent)
    outer = with_gaps(area, perimeter, size)
    found = TrianglePieces(corners, parent, outer, f.c, outer * _known(f) ** 2, *np.zeros((2, len(parent))))
    near = {step: ~np.isnan(of_step) for step, of_step in wrong.items()}
    for step, at in near.items():
        here = {each: value[at] for each, value in steps.items()}
        by = _model(vertices[at], size, data, here | {step: 1 - here[step]}) + f.on(at).scaled(-1.0)
        _jump(found, at, by, wrong[step][at], rounding(vertices[at], data.jumps[step], size), area[at])
    several = np.sum([*near.values()], axis=0) > 1
    if several.any():
        _jumps(found, several, vertices[several], size, data, steps, wrong)
    return found


def _jump(found: TrianglePieces, at: Mask, by: Model, wrong: Array, doubt: Array, area: Array) -> None:
    """Account for parts of the pieces `at` where f is larger `by` so much; their areas are `wrong` (k,).

    The areas are known up to `doubt` (k,). p is changed by a constant so that its integral is that of f.
    """
    lower, upper = by.range
    middle, most = 0.5 * (lower + upper), np.maximum(np.abs(lower), np.abs(upper))
    shift = middle * wrong / area
    found.c[0, at] += shift
    found.jumping[at] += most * np.sqrt(wrong + doubt) + np.abs(shift) * np.sqrt(area)
    found.integral[at] += 0.5 * (upper - lower) * wrong + most * doubt


def _jumps(
    found: TrianglePieces, at: Mask, vertices: Array, size: float, data: Data, steps: Steps, wrong: Steps
) -> None:
    """Account for places where several steps are wrong at once.

    f is off there by no more than all its values on the piece differ.
    """
    both = {step: np.where(np.isnan(wrong[step][at]), value[at], np.nan) for step, value in steps.items()}
    lower, upper = _model(vertices, size, data, both).range
    doubts = [rounding(vertices, kink, size) for kink in data.jumps.values()]
    areas = [np.nan_to_num(wrong[step][at]) + doubt for step, doubt in zip(wrong, doubts, strict=True)]
    second = np.sort(areas, axis=0)[-2]
    most = (1 + len(areas)) * (upper - lower)
    found.jumping[at] += most * np.sqrt(len(areas) * second)
    found.integral[at] += most * len(areas) * second


def _ordered(vertices: Array) -> tuple[Index, Array]:
    """(k, 3) the corners, the one opposite to the longest edge first, and the perimeters (k,)."""
    lengths = np.linalg.norm(vertices[:, [2, 0, 1]] - vertices[:, [1, 2, 0]], axis=2)
    return (np.argmax(lengths, axis=1)[:, None] + np.arange(3)) % 3, lengths.sum(axis=1)


def _model(vertices: Array, size: float, data: Data, steps: Steps) -> Model:
    """f on pieces of a mesh whose coordinates are at most `size`."""
    x, y = (_coordinate(vertices[..., i], ROUNDING * size) for i in range(2))
    return data.source_model(x, y, steps)


def _known(f: Model) -> Array:
    """(k,) a bound on |f - p|, which includes the rounding of p."""
    return np.asarray(f.rad + 32 * EPS * np.abs(f.c).sum(axis=0))


def _coordinate(of_vertices: Array, rounding: float) -> Model:
    """x or y on pieces, from its values (k, 3) at the vertices, which are rounded by that much."""
    a, b, c = of_vertices.T
    ends = of_vertices.min(axis=1) - rounding, of_vertices.max(axis=1) + rounding
    return affine(basis(2, ORDER), 0.5 * (b + c), 0.5 * np.stack([b - a, c - a]), ends, rounding)
