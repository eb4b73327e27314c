"""The guaranteed total error of a discrete solution, by the hypercircle.

For v in H^1 with v >= g and q in H(div) with q.n >= 0 on the boundary, q.n = 0 on its free sides,

    ||u - v||_1^2 + ||q - grad u||^2 + ||f + div q - u||^2 + 2 <lambda, v - g> + 2 <q.n, u - g>
        = ||grad v - q||^2 + ||v - f - div q||^2 + 2 <q.n, v - g>  =: eta^2;

nothing on the left is negative, so eta bounds ||u - v||_1 and, by the second and the third term,
||lambda - q.n||_{-1/2}. Here v is of P2: the solution of (1.1) with v = g where (u_h, lambda_H) is in
contact and dv/dn = 0 elsewhere, made feasible: v + w is what `feasible` gives for v, and ||w||_1 is added to
the root of the squares. q is the best flux of RT1 whose q.n is the linear part of lambda_H on every edge, its
slope limited so that q.n >= 0. For a lambda_H that jumps inside edges a bound of ||lambda_H - q.n||_{-1/2} is
added.

This eta is of higher order than ||u - u_h||_1. With d = v - u_h and any extension d_0 of d's trace,

    ||u - u_h||_1^2 = ||d||_1^2 + 2 (u - v, d)_1 + ||u - v||_1^2,
    (u - v, d)_1 = (f, d) + <q.n, d> - (v, d)_1 + <lambda - q.n, d>,   <lambda - q.n, d> <= eta ||d_0||_1,

so that the index tends to 1. Nothing is asked of u_h, neither orthogonality nor convergence.

All this is for f_h, the L2 projection of f onto linear functions on each triangle, in place of f, with the
solution u~, lambda~. The Riesz representatives r of f - f_h and m of lambda - lambda~ satisfy u - u~ = m + r
and (m, m + r)_1 = <lambda - lambda~, u - u~> <= 0, so that neither ||u - u~||_1 nor
||lambda - lambda~||_{-1/2} exceeds

    ||r||_1 <= (sum over T of min(1, d_T / pi)^2 ||f - f_h||_T^2)^{1/2},

d_T the diameter of T, by the inequality of Payne and Weinberger (1960); that is added to both bounds.
They are guaranteed up to rounding and the quadrature of f and g. That of f is checked, not proved: a second
rule, on triangles cut each in another way, projects f again; DOUBT times the distance of both projections is
added, without the factor of Payne and Weinberger, for their difference need not have mean 0. And where a
bound of |f| is given, both rules have to see at least SEEN times that, or both bounds are infinite.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from unilateral.errors import InputError
from unilateral.feasible import Constraint, Obstacle, constraint
from unilateral.hypercircle import hypercircle
from unilateral.mesh import Mesh
from unilateral.mesh_io import longest_edges
from unilateral.oscillation import MEAN_FREE_ON_SQUARE, ON_SQUARE, oscillation_bound
from unilateral.partition import Partition
from unilateral.quadrature import DEGREE, triangle_rules

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
PUSH = 0.5
"""Of H_i lambda_i: what lies less than that above g counts as contact. Only the sharpness depends on it."""
SEEN = 0.5
"""Of the bound of |f|: what the largest |f| at the points of the rules must reach."""
DOUBT = 2.0
"""What the distance of two projections of f counts."""


class Data(Obstacle, Protocol):
    """f and g of a unilateral problem (1.1), (1.2)."""

    def source(self, points: Array, offset: Array | float = 0.0) -> Array:
        """f (k,) at the places points + offset (k, 2)."""


@dataclass(frozen=True)
class TotalBound:
    """u >= ||u - u_h||_1 and lambda_ >= ||lambda - lambda_H||_{-1/2}, and what they are made of.

    `eta` is the hypercircle's; `distance` ||v - u_h||_1; `extension` ||w||_1; `data` what f - f_h can do at
    most; `oscillation` bounds ||lambda_H - q.n||_{-1/2}.
    """

    u: float
    lambda_: float
    eta: float
    distance: float
    extension: float
    data: float
    oscillation: float


def total_bound(
    problem: Data,
    mesh: Mesh,
    cells: Partition,
    u_h: Array,
    lambda_H: Array,
    free: Collection[int] = (),
    largest_source: float = 0.0,
) -> TotalBound:
    """Bounds for any u_h (n,) in V_h and lambda_H (m,) in Lambda_H, which is 0 on the `free` sides.

    They are as sharp as (u_h, lambda_H) is near the discrete solution. g has to be in H^1 of every side that
    is not free, at least where it exceeds `feasible`'s v. Raises InputError if the arrays do not fit the mesh
    and the cells, or lambda_H is negative somewhere or not 0 on a free side. They are infinite where
    quadrature misses a peak of f: `largest_source` bounds |f|, if such a bound is known.
    """
    _check(mesh, cells, u_h, lambda_H, free)
    f_h, data = _projected_source(problem, mesh, largest_source)
    spaces, flux, held = (
        hypercircle(mesh, f_h),
        _on_edges(mesh, cells, lambda_H),
        ~np.isin(mesh.side, [*free]),
    )
    u, g = spaces.of_p1(u_h), constraint(problem, mesh, spaces.on_edges, spaces.p2.N, held)
    contact = _contact(g, u, flux.push)
    v, q = g.lifted(spaces.potential(contact, g.at_unknowns)), spaces.best_flux(flux.ends)
    missing = g.missing(v, contact, spaces.triangle)
    slack = max(float(np.sum(flux.ends * missing.slack)), 0.0)
    eta = math.sqrt((math.sqrt(spaces.defect(v, q)) + missing.norm) ** 2 + 2 * slack)
    d, of_v = v - u, eta + missing.norm
    distance, of_trace = spaces.norm(d), spaces.norm(spaces.extension(d, held))
    residual = float(d @ (spaces.load + spaces.boundary_load(flux.ends) - spaces.A @ v))
    product = min(residual + eta * of_trace, of_v * distance)
    oscillation = oscillation_bound(mesh, spaces.triangle, flux.rest[:, None], flux.constant).item()
    return TotalBound(
        u=math.sqrt(max(distance**2 + 2 * product + of_v**2, 0.0)) + data,
        lambda_=eta + oscillation + data if np.any(held) else 0.0,
        eta=eta,
        distance=distance,
        extension=missing.norm,
        data=data,
        oscillation=oscillation,
    )


def _check(mesh: Mesh, cells: Partition, u_h: Array, lambda_H: Array, free: Collection[int]) -> None:
    if not np.array_equal(mesh.polygon.vertices, cells.polygon.vertices):
        raise InputError("the partition lies on another polygon than the mesh; give both the same polygon")
    for name, values, n in (("u_h", u_h, mesh.n_nodes), ("lambda_H", lambda_H, cells.n_cells)):
        if np.shape(values) != (n,) or not np.all(np.isfinite(values)):
            raise InputError(f"{name} must hold {n} finite numbers; it has the shape {np.shape(values)}")
    if np.min(lambda_H) < 0:
        raise InputError(f"lambda_H has the value {np.min(lambda_H):.4g}; it must not be negative")
    loaded = np.flatnonzero(np.isin(cells.side, [*free]) & (lambda_H > 0))
    if loaded.size:
        raise InputError(f"lambda_H is not 0 on side {cells.side[loaded[0]]}, which is free; it must be")


def _projected_source(problem: Data, mesh: Mesh, largest: float = 0.0) -> tuple[Array, float]:
    """f_h (m, 3) at the triangles' vertices, and the bound of what f - f_h does; `largest` bounds |f|."""
    f_h, squares, seen = _projection(problem, mesh)
    again, squares_again, seen_again = _projection(problem, mesh, DEGREE, cut=True)
    if SEEN * largest > max(min(seen, seen_again), np.finfo(float).tiny):
        return f_h, math.inf
    share = np.minimum(1.0, longest_edges(mesh.points, mesh.triangles) / math.pi)
    oscillation = math.sqrt(float(share**2 @ np.maximum(squares, squares_again)))
    apart = f_h - again
    distance = math.sqrt(float(mesh.areas @ (np.sum(apart**2, axis=1) + apart.sum(axis=1) ** 2)) / 12)
    return f_h, oscillation + DOUBT * distance


def _projection(
    problem: Data, mesh: Mesh, degree: int | None = None, cut: bool = False
) -> tuple[Array, Array, float]:
    """f_h (m, 3), ||f - f_h||_T^2 (m,) and the largest |f|, by those `triangle_rules`."""
    values = []
    moments, squares = np.zeros((len(mesh.triangles), 3)), np.zeros(len(mesh.triangles))
    for rule in triangle_rules(mesh, problem, degree, cut):
        f = problem.source(rule.origin, rule.offset).reshape(rule.weight.shape)
        np.add.at(moments, rule.triangle, np.einsum("kq,kqb->kb", rule.weight * f, rule.barycentric))
        values.append(f)
    f_h = (12 * moments - 3 * moments.sum(axis=1, keepdims=True)) / mesh.areas[:, None]
    for rule, f in zip(triangle_rules(mesh, problem, degree, cut), values, strict=True):
        rest = f - np.einsum("kb,kqb->kq", f_h[rule.triangle], rule.barycentric)
        np.add.at(squares, rule.triangle, np.sum(rule.weight * rest**2, axis=1))
    return f_h, squares, max(float(np.abs(f).max(initial=0.0)) for f in values)


class EdgeFlux(NamedTuple):
    """lambda_H on the boundary edges: at their `ends` (nb, 2) its linear part, the slope limited, so >= 0.

    `rest` (nb,) is the squared L2 norm of what is left, `constant` (nb,) is what `oscillation` needs to bound
    that in ||.||_{-1/2}; `push` (nb,) is the largest H_i lambda_i of a cell there.
    """

    ends: Array
    rest: Array
    constant: Array
    push: Array


def _on_edges(mesh: Mesh, cells: Partition, lambda_H: Array) -> EdgeFlux:
    points, lengths, nb = np.union1d(cells.points, mesh.s), np.diff(mesh.s), len(mesh.boundary)
    middle = 0.5 * (points[1:] + points[:-1])
    cell, edge = (np.searchsorted(s, middle) - 1 for s in (cells.points, mesh.s))
    share, arm = np.diff(points) / lengths[edge], 2 * (middle - mesh.s[edge]) / lengths[edge] - 1
    value = lambda_H[cell]
    mean = np.bincount(edge, share * value, nb)
    slope = 3 * np.bincount(edge, share * arm * value, nb)
    limited = np.clip(slope, -mean, mean)
    squares = np.bincount(edge, share * (value - mean[edge]) ** 2, nb)
    rest = np.maximum(squares + (limited - 2 * slope) * limited / 3, 0.0)
    push = np.zeros(nb)
    np.maximum.at(push, edge, (cells.lengths * lambda_H)[cell])
    return EdgeFlux(
        np.column_stack([mean - limited, mean + limited]),
        rest=lengths * rest,
        constant=np.where(limited == slope, ON_SQUARE, MEAN_FREE_ON_SQUARE),
        push=push,
    )


def _contact(g: Constraint, u_h: Array, push: Array) -> Mask:
    """(n,) P2's unknowns in contact: u_h - g is below PUSH H_i lambda_i of a cell there."""
    largest = np.zeros(len(u_h))
    np.maximum.at(largest, g.unknowns, push[:, None])
    return u_h - g.at_unknowns < PUSH * largest
