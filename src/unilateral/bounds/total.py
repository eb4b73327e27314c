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

All this is for f_h, a linear function on each triangle (`source`), in place of f, with the solution u~,
lambda~. The Riesz representatives r of f - f_h and m of lambda - lambda~ satisfy u - u~ = m + r and
(m, m + r)_1 = <lambda - lambda~, u - u~> <= 0, so that neither ||u - u~||_1 nor ||lambda - lambda~||_{-1/2}
exceeds ||r||_1, the norm of f - f_h in the dual of H^1; its bound is added to both.

f and g enter by enclosures, never by samples. What rounding may have done to integrals is added.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.bounds.constraint import Constraint, constraint
from unilateral.bounds.feasible import missing, raised
from unilateral.bounds.hypercircle import Hypercircle
from unilateral.bounds.source import Source
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.oscillation import MEAN_FREE_ON_SQUARE, ON_SQUARE, oscillation_bound
from unilateral.problems.obstacle import Obstacle

PUSH = 0.5
"""Of H_i lambda_i: what lies less than that above g counts as contact. Only the sharpness depends on it."""
SUMS = 1e-9
"""Of a sum of squares: its rounding, at most."""


@dataclass(frozen=True)
class TotalBound:
    """u >= ||u - u_h||_1 and lambda_ >= ||lambda - lambda_H||_{-1/2}, and what they are made of.

    `eta` is the hypercircle's; `distance` ||v - u_h||_1; `extension` ||w||_1; `data` what f - f_h can do at
    most; `oscillation` bounds ||lambda_H - q.n||_{-1/2}. `unknown` is the part that would be 0 if f and g
    were the polynomials by which they are enclosed; of that `irreducible` hardly falls on finer meshes.
    """

    u: float
    lambda_: float
    eta: float
    distance: float
    extension: float
    data: float
    oscillation: float
    unknown: float
    irreducible: float


def total_bound(
    spaces: Hypercircle,
    source: Source,
    obstacle: Obstacle,
    cells: Partition,
    u_h: Array,
    lambda_H: Array,
    free: Collection[int] = (),
) -> TotalBound:
    """Bounds for any u_h (n,) in V_h and lambda_H (m,) in Lambda_H, which is 0 on the `free` sides.

    They are as sharp as (u_h, lambda_H) is near the discrete solution. `spaces` are those of the source's
    mesh, which may serve any number of bounds. Raises InputError if the arrays do not fit the mesh and the
    cells, or lambda_H is negative somewhere or not 0 on a free side.
    """
    mesh = spaces.mesh
    if source.mesh is not mesh:
        raise InputError(
            "the source is enclosed on another mesh than that of the spaces; give both the same mesh"
        )
    _check(mesh, cells, u_h, lambda_H, free)
    f, flux = spaces.linear(source.f_h), _on_edges(mesh, cells, lambda_H)
    held = ~np.isin(mesh.side, [*free])
    u, g = spaces.of_p1(u_h), constraint(obstacle, mesh, spaces.on_edges, spaces.p2.N, held)
    contact = _contact(g, u, flux.push)
    stiffness, at_edges = spaces.A.diagonal()[spaces.on_edges[:, 2]], (spaces.triangle, flux.ends)
    v, touching = raised(g, spaces.potential(f, contact, g.at_unknowns), contact, *at_edges, stiffness)
    q, short = spaces.best_flux(f, flux.ends), missing(g, v, touching, *at_edges)
    of_doubt = spaces.norm(spaces.of_p1(short.added))
    extension, defect = short.norm + of_doubt, math.sqrt(spaces.defect(f, v, q))
    defect += spaces.rounding(f, v, defect)
    eta = (1 + SUMS) * math.sqrt((defect + extension) ** 2 + 2 * max(short.slack, 0.0))
    d, of_v = v - u, eta + extension
    distance, of_trace = (1 + SUMS) * spaces.norm(d), (1 + SUMS) * spaces.norm(spaces.extension(d, held))
    residual = spaces.product(d, f.load + spaces.boundary_load(flux.ends), v)
    product = min(residual + eta * of_trace, of_v * distance)
    oscillation = oscillation_bound(mesh, spaces.triangle, flux.rest[:, None], flux.constant).item()
    data = (1 + SUMS) * source.distance
    return TotalBound(
        u=(1 + SUMS) * math.sqrt(max(distance**2 + 2 * product + of_v**2, 0.0)) + data,
        lambda_=eta + (1 + SUMS) * oscillation + data if np.any(held) else 0.0,
        eta=eta,
        distance=distance,
        extension=extension,
        data=data,
        oscillation=oscillation,
        unknown=source.unknown + of_doubt,
        irreducible=of_doubt + (0.0 if source.resolved else source.unknown),
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
    lengths, nb = np.diff(mesh.s), len(mesh.boundary)
    points, cell, edge = overlay(cells.points, mesh.s)
    middle = 0.5 * (points[1:] + points[:-1])
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
