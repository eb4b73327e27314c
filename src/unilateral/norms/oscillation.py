"""What a flux that is linear on the boundary edges does not carry, bounded in ||.||_{-1/2}.

Let r be orthogonal to the linear functions on every boundary edge e. Where a square Q can be erected on e
inside Omega, apart from the squares on other sides,

    <r, v>_e <= (C h_e)^{1/2} ||r||_e |v|_{1,Q},  C = 1/(2 pi tanh 2 pi):

the harmonic functions cos(k pi x) cosh(k pi (1 - y)) diagonalise the right-hand side, cos(pi x) is all but
excluded by the linear functions, and cos(2 pi x) remains. Where r is orthogonal to constants only, cos(pi x)
remains too: C = 1/(pi tanh pi). Elsewhere the triangle T at e serves: r is
orthogonal to the mean of v in T, and

    ||v - mean_T v||_e^2 <= |e|/|T| (d^2/pi^2 + a d/pi) |v|_{1,T}^2,

d the diameter of T and a the greater distance of its vertex off e from the ends of e, by the divergence
theorem with the field x - vertex and the inequality of Payne and Weinberger (1960). Squares do not overlap,
nor do triangles; what they bound is added.
"""

from __future__ import annotations

import math

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.fem.form import H1, Form
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.plane import segment_distances
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import round_off

SQUARE_CONSTANT = 1 / (2 * math.pi * math.tanh(2 * math.pi))
MEAN_FREE_SQUARE_CONSTANT = 1 / (math.pi * math.tanh(math.pi))
SQUARE_REACH = math.sqrt(5) / 2
"""A square reaches this far from the midpoint of its edge, in lengths of the edge."""


def oscillation_bound(
    mesh: Mesh, squared_norms: Array, square_constant: Array | float = SQUARE_CONSTANT, form: Form = H1
) -> Array:
    """Bounds (k,) on ||r||_{-1/2}, the dual of the energy norm, from ||r||_e^2 (nb, k).

    `square_constant` is C, for all edges or each (nb,).
    """
    square_terms, triangle_terms = oscillation_constants(mesh, square_constant, form) @ squared_norms
    return np.asarray(np.sqrt(square_terms) + np.sqrt(triangle_terms))


def oscillation_constants(
    mesh: Mesh, square_constant: Array | float = SQUARE_CONSTANT, form: Form = H1
) -> Array:
    """The factors (2, nb) of ||r||_e^2 in the terms of `oscillation_bound`, by squares and by triangles."""
    on_squares = np.where(has_square(mesh), square_constant * np.diff(mesh.s) / form.k, math.inf)
    # the smaller one of the constants for |v|_{1,T} and for ||v||_T
    on_triangles = np.minimum(trace_constants(mesh) / form.k, value_constants(mesh, form))
    # squares, and triangles, do not overlap: sums of squares over each kind, and the roots are added
    by_square = on_squares <= on_triangles
    return np.stack([np.where(by_square, on_squares, 0.0), np.where(by_square, 0.0, on_triangles)])


def has_square(mesh: Mesh) -> Mask:
    """Whether the square on each edge lies inside Omega, and apart from any square on another side, (nb,)."""
    # so do the squares on the exact edges (`geometry.exact_mesh`): node_shifts and stretch
    lengths = np.diff(mesh.s)
    start = mesh.points[mesh.boundary]
    middle = 0.5 * (start + np.roll(start, -1, axis=0))
    distance = distance_to_other_sides(mesh.polygon, middle, mesh.side)
    # the other square reaches as far, on an edge as long as the longest; nodes may lie elsewhere by rounding
    displacement = 4 * float(mesh.node_shifts.max()) + round_off(mesh.polygon)
    return (
        distance > SQUARE_REACH * (1 + mesh.polygon.stretch.max()) * (lengths + lengths.max()) + displacement
    )


def distance_to_other_sides(polygon: Polygon, points: Array, side: Index) -> Array:
    """The distance of points on sides from the other sides, (k,)."""
    distance = segment_distances(points, polygon.vertices, np.roll(polygon.vertices, -1, axis=0))
    distance[np.arange(len(points)), side] = np.inf
    return np.asarray(distance.min(axis=1))


def trace_constants(mesh: Mesh, poincare: float = 1 / math.pi) -> Array:
    """The constants C (nb,) of ||v - mean_T v||_e^2 <= C |v|_{1,T}^2, T the triangle at each boundary edge.

    They are doubled where two edges share a triangle, and hold if ||v - mean_T v||_T is at most `poincare`
    times d |v|_{1,T}.
    """
    e, far, area, shared = _edge_geometry(mesh)
    reach = poincare * np.maximum(far, e)
    # |e|/|T| ((P d)^2 + a P d), P for `poincare`, and the greater of a and |e| for d
    return np.asarray(shared * e / area * (reach**2 + far * reach))


def value_constants(mesh: Mesh, form: Form) -> Array:
    """The constants C (nb,) of ||v||_e^2 <= C ||v||_T^2, the energy norm on T; doubled where edges share T.

    C is |e|/|T| (1/c + (1/c^2 + a^2/(c k))^(1/2))/2: the divergence theorem with the same field gives
    ||v||_e^2 <= |e|/|T| (||v||_T^2 + a ||v||_T |v|_{1,T}). It is infinite for c = 0.
    """
    e, far, area, shared = _edge_geometry(mesh)
    if not form.c:
        return np.full(len(e), math.inf)
    return np.asarray(shared * e / area * (1 + np.sqrt(1 + form.c / form.k * far**2)) / (2 * form.c))


def _edge_geometry(mesh: Mesh) -> tuple[Array, Array, Array, Index]:
    """The boundary edges' lengths, the distances a, their triangles' areas, and how many share each."""
    start = mesh.boundary
    end = np.roll(mesh.boundary, -1)
    triangle = mesh.boundary_triangles
    apex = mesh.triangles[triangle].sum(axis=1) - start - end
    e = np.hypot(*(mesh.points[start] - mesh.points[end]).T)
    a = np.hypot(*(mesh.points[start] - mesh.points[apex]).T)
    b = np.hypot(*(mesh.points[end] - mesh.points[apex]).T)
    shared = np.bincount(triangle, minlength=len(mesh.triangles))[triangle]
    return e, np.maximum(a, b), mesh.areas[triangle], shared
