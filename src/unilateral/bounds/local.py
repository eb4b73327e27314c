"""The guaranteed total error of a discrete solution by problems on vertex patches.

u~ and lambda~ are the solution for f~ in place of f. For q in H(div) with q.n = sigma >= 0 on the boundary,
0 on free sides, and d in H^1 with u_h + d >= g, put X = ||u~ - u_h||_1, D = ||d||_1,

    Y^2 = ||q - grad u~||^2 + ||f~ + div q - u~||^2,
    R = ||grad u_h - q||^2 + ||u_h - f~ - div q||^2 + 2 <sigma, u_h + d - g>.

Then X^2 + Y^2 <= R + 2 Y D. So X^2 <= R + D^2, and ||lambda~ - sigma||_{-1/2} <= Y <= D + (R + D^2)^{1/2}.
Proof: with the mixed terms <lambda~ - sigma, u~ - u_h> integrated by parts,

    X^2 + Y^2 = ||grad u_h - q||^2 + ||u_h - f~ - div q||^2 + 2 <lambda~ - sigma, u~ - u_h - d>
                + 2 <lambda~ - sigma, d>;

the first product is at most <sigma, u_h + d - g>, since <lambda~, u~ - g> = 0, lambda~ >= 0 and
<sigma, u~ - g> >= 0; the second is at most Y D. With u_h + d in place of u_h, and 0 in place of d, the same
says Y <= eta, the square of which is R for u_h + d.

f - f~ is what `source` leaves of f and, on each triangle, u_h less its mean. So u_h - f~ - div q is constant
there, and by the div q of `equilibrated` it is 0 where (u_h, lambda_H) solves the discrete problem. d is what
makes u_h feasible (`feasible`); it is 0 but on the triangles at boundary nodes. Nothing is asked of u_h and
lambda_H. The sums over triangles have what rounding may have done to them added.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array, Index, Mask
from unilateral.bounds.constraint import constraint
from unilateral.bounds.edge_flux import SUMS, EdgeFlux, check, edge_flux, in_contact
from unilateral.bounds.equilibrated import equilibrated
from unilateral.bounds.feasible import Missing, missing, raised
from unilateral.bounds.layer import Layer, layer, linear_squares
from unilateral.bounds.source import Source
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.oscillation import oscillation_bound
from unilateral.problems.obstacle import Obstacle

BLOCK = 8192
"""Triangles at a time, whose numbers fit into a processor's cache."""
ROUNDING = 2.0**-45
"""Of the sizes of the terms of a sum: 64 units in the last place, for some 20 operations each."""


@dataclass(frozen=True)
class LocalBound:
    """u >= ||u - u_h||_1 and lambda_ >= ||lambda - lambda_H||_{-1/2}, and what they are made of.

    `flux` is ||grad u_h - q||, `residual` ||u_h - f~ - div q||, `lifting` bounds ||d||_1, and `data` what
    f - f~ can do. `unknown` is the part that would be 0 if f and g were the polynomials by which they are
    enclosed; of that `irreducible` hardly falls on finer meshes.

    `shares` (m,) are the triangles' parts of u^2: of the squares of flux, residual, lifting and data, and of
    2 <sigma, u_h + d - g>. Their sum is at most u^2 and, but for rounding, at least u^2 / 6.
    """

    u: float
    lambda_: float
    flux: float
    residual: float
    lifting: float
    data: float
    unknown: float
    irreducible: float
    shares: Array


def local_bound(
    source: Source,
    obstacle: Obstacle,
    cells: Partition,
    u_h: Array,
    lambda_H: Array,
    free: Collection[int] = (),
) -> LocalBound:
    """Bounds for any u_h (n,) in V_h and lambda_H (m,) in Lambda_H, which is 0 on the `free` sides.

    They are as sharp as (u_h, lambda_H) is near the discrete solution. Raises InputError if the arrays do not
    fit the mesh and the cells, or lambda_H is negative somewhere or not 0 on a free side.
    """
    mesh = source.mesh
    check(mesh, cells, u_h, lambda_H, free)
    flux, held = edge_flux(mesh, cells, lambda_H), ~np.isin(mesh.side, [*free])
    q, of = equilibrated(mesh, u_h, source.moments, flux.ends), layer(mesh)
    d, short = _lifted(of, obstacle, u_h, flux, held)
    squares, residual, rounding = _defects(source, u_h, q)
    added = of.function(short.added[mesh.boundary], np.zeros(len(mesh.boundary)))
    of_d, of_added = _norms(of, *d), _norms(of, *added)
    lifting = (1 + SUMS) * (_root(of_d) + short.norm + _root(of_added))
    inside = squares + mesh.areas * residual**2
    defect, slack = _root(inside) + rounding, 2 * short.product
    of_u = (1 + SUMS) * math.sqrt(defect**2 + slack + lifting**2)
    moved = _of_feasible(of, u_h, q, inside, residual, *d)
    eta = (1 + SUMS) * math.sqrt((_root(moved) + rounding + short.norm + _root(of_added)) ** 2 + slack)
    oscillation = (1 + SUMS) * oscillation_bound(
        mesh, mesh.boundary_triangles, flux.rest[:, None], flux.constant
    ).item()
    of_data = _of_data(source, u_h)
    data = (1 + SUMS) * _root(of_data)
    shares = inside + of_data
    shares[of.triangles] += of_d + of_added
    np.add.at(shares, mesh.boundary_triangles, short.squares + 2 * short.slack)
    return LocalBound(
        u=of_u + data,
        lambda_=min(lifting + of_u, eta) + oscillation + data if np.any(held) else 0.0,
        flux=_root(squares),
        residual=math.sqrt(mesh.areas @ residual**2),
        lifting=lifting,
        data=data,
        unknown=source.unknown + _root(of_added),
        irreducible=_root(of_added) + (0.0 if source.resolved else source.unknown),
        shares=shares,
    )


def _lifted(
    of: Layer, obstacle: Obstacle, u_h: Array, flux: EdgeFlux, held: Mask
) -> tuple[tuple[Array, Array], Missing]:
    """d but for what `missing` adds, and that; `held` (nb,) are the edges with g."""
    nb, ends = len(held), u_h[of.mesh.boundary]
    start, trace = np.arange(nb), np.concatenate([ends, 0.5 * (ends + np.roll(ends, -1))])
    unknowns = np.column_stack([start, (start + 1) % nb, nb + start])
    g, triangle = constraint(obstacle, of.mesh, unknowns, 2 * nb, held), of.mesh.boundary_triangles
    contact = in_contact(g, trace, flux.push)
    v, touching = raised(g, trace, contact, triangle, flux.ends, of.bubble_squares())
    d = of.function(v[:nb] - ends, v[nb:] - 0.5 * (v[:nb] + np.roll(v[:nb], -1)))
    return d, missing(g, v, touching, triangle, flux.ends)


def _norms(of: Layer, hats: Array, bubbles: Array) -> Array:
    """(k,) the squares of the H1 norms of a function of the layer."""
    return linear_squares(of.areas, of.gradients(hats, bubbles)) + of.squares(hats, bubbles)


def _root(squares: Array) -> float:
    return math.sqrt(float(squares.sum()))


def _of_feasible(
    of: Layer, u_h: Array, q: Array, squares: Array, residual: Array, hats: Array, bubbles: Array
) -> Array:
    """(m,) ||grad v - q||^2 + ||v - f~ - div q||^2 for v = u_h + d, from their `squares` for u_h."""
    here = of.triangles
    gradient = _misfit(of.mesh, u_h, q, here).transpose(2, 1, 0) + of.gradients(hats, bubbles)
    found = squares.copy()
    found[here] = linear_squares(of.areas, gradient) + of.squares(hats + residual[here, None], bubbles)
    return found


def _misfit(mesh: Mesh, u_h: Array, q: Array, of: Index | slice) -> Array:
    """(2, 3, k) grad u_h - q at the nodes of those triangles.

    At a node flow in through the edge to the next node and out through that from the node before determine q.
    """
    node = np.ascontiguousarray(mesh.triangles[of].T)
    x, y = mesh.points[node].transpose(2, 0, 1)
    e, f = (z[[2, 0, 1]] - z[[1, 2, 0]] for z in (x, y))
    u, into, out = u_h[node], q[0][:, of], -q[1][:, of][[2, 0, 1]]
    found = [
        sign * np.sum(u * along, axis=0) + across[[1, 2, 0]] * into + across[[2, 0, 1]] * out
        for sign, along, across in ((-1, f, e), (1, e, f))
    ]
    return np.stack(found) / (2 * mesh.areas[of])


def _defects(source: Source, u_h: Array, q: Array) -> tuple[Array, Array, float]:
    """(m,) ||grad u_h - q||^2 and u_h - f~ - div q on each triangle, and what rounding adds to the norm."""
    mesh, sizes = source.mesh, 0.0
    squares, residual = np.empty((2, len(mesh.triangles)))
    for begin in range(0, len(squares), BLOCK):
        of = slice(begin, begin + BLOCK)
        area, u, moments = mesh.areas[of], u_h[mesh.triangles[of]], source.moments[of]
        squares[of] = linear_squares(area, _misfit(mesh, u_h, q, of).transpose(2, 1, 0))
        flow = q[:, :, of].sum(axis=(0, 1))
        residual[of] = u.mean(axis=1) + (0.5 * flow - moments.sum(axis=1)) / area
        steep = mesh.longest_edges[of] / area
        size = np.abs(u).max(axis=1) * (1 + steep) + np.abs(q[:, :, of]).sum(axis=(0, 1)) * (steep + 1 / area)
        sizes += float(area @ (size + np.abs(moments).sum(axis=1) / area) ** 2)
    return squares, residual, ROUNDING * math.sqrt(sizes)


def _of_data(source: Source, u_h: Array) -> Array:
    """(m,) the squares whose sum's root bounds the norm of f - f~ in the dual of H^1."""
    left = source.f_h - u_h[source.mesh.triangles]
    left -= left.mean(axis=1, keepdims=True)
    return source.squares_with(np.sqrt(linear_squares(source.mesh.areas, left)))
