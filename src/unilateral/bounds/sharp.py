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

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.constraint import constraint
from unilateral.bounds.edge_flux import SUMS, check, edge_flux, in_contact
from unilateral.bounds.feasible import missing, raised
from unilateral.bounds.hypercircle import Hypercircle
from unilateral.bounds.source import Source
from unilateral.errors import InputError
from unilateral.geometry.partition import Partition
from unilateral.norms.oscillation import oscillation_bound
from unilateral.problems.obstacle import Obstacle


@dataclass(frozen=True)
class SharpBound:
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


def sharp_bound(
    spaces: Hypercircle,
    source: Source,
    obstacle: Obstacle,
    cells: Partition,
    u_h: Array,
    lambda_H: Array,
    free: Collection[int] = (),
) -> SharpBound:
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
    check(mesh, cells, u_h, lambda_H, free)
    f, flux = spaces.linear(source.f_h), edge_flux(mesh, cells, lambda_H)
    held = ~np.isin(mesh.side, [*free])
    u, g = spaces.of_p1(u_h), constraint(obstacle, mesh, spaces.on_edges, spaces.p2.N, held)
    contact = in_contact(g, u, flux.push)
    stiffness, at_edges = spaces.A.diagonal()[spaces.on_edges[:, 2]], (spaces.triangle, flux.ends)
    v, touching = raised(g, spaces.potential(f, contact, g.at_unknowns), contact, *at_edges, stiffness)
    q, short = spaces.best_flux(f, flux.ends), missing(g, v, touching, *at_edges)
    of_doubt = spaces.norm(spaces.of_p1(short.added))
    extension, defect = short.norm + of_doubt, math.sqrt(spaces.defect(f, v, q))
    defect += spaces.rounding(f, v, defect)
    eta = (1 + SUMS) * math.sqrt((defect + extension) ** 2 + 2 * short.product)
    d, of_v = v - u, eta + extension
    distance, of_trace = (1 + SUMS) * spaces.norm(d), (1 + SUMS) * spaces.norm(spaces.extension(d, held))
    residual = spaces.product(d, f.load + spaces.boundary_load(flux.ends), v)
    product = min(residual + eta * of_trace, of_v * distance)
    oscillation = oscillation_bound(mesh, spaces.triangle, flux.rest[:, None], flux.constant).item()
    data = (1 + SUMS) * source.distance
    return SharpBound(
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
