"""The guaranteed total error of a discrete solution, by a flux and a potential that are nearly the best ones.

By the theorem of `total_errors` the bounds follow from the residuals of u_h and of a feasible v (`residual_norm`)
with one flux q. Both begin with w of V_h, which is u_h or near it, and the flux of patches for w (`balanced`).

The flux gets a divergence that is linear on each triangle T. With p = c w - f_h, its values p_k at the nodes
x_k, and the hats psi_k there, q gets theta r,

    r = sum_k p_k psi_k (x - x_k) / 3,     div r = p - mean p,     r.n = 0 on the edges,
    theta = k ||div r||_T^2 / (k ||div r||_T^2 + c ||r||_T^2),

since div (psi_k (x - x_k)) = 3 psi_k - 1. f_h is the linear part of f. On small triangles theta is nearly 1,
and the mean-free part of rho = f_h + div q - c w nearly 0; on triangles larger than (k/c)^(1/2) all of r would
cost more than it gains. With curl phi, phi of P2 and 0 on the boundary but for clamped sides, div q, and q.n on
the other sides, stay what they are: these are all fluxes of RT1 with those. The potential v of P2 is g where
(u_h, lambda_H) is in contact, u_D on clamped sides, and goes from w towards the solution of (1.1) with
k dv/dn = tau~ on free sides and 0 elsewhere; at last it is made feasible. Both reduce

    ||q - k grad v||^2 / k + ||f_h + div q - c v||^2 / c + 2 <sigma, v - g>

independently of each other: (grad v, curl phi) = 0, and the best v does not depend on q. They are found by
conjugate gradients, and every iterate will do.

Where u and f are smooth the bound on u tends to |||u - u_h|||, for eta is of higher order. Nothing is assumed
of u_h and lambda_H. What rounding and the exact mesh may do is added on each triangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import edge_flux
from unilateral.bounds.clamped_ends import outflows
from unilateral.bounds.feasible import Lifting, Missing, lifting
from unilateral.bounds.flux_residuals import ROUNDING, SUMS, defects, misfit, root
from unilateral.bounds.local_bounds import Bound, check, flux_of
from unilateral.bounds.mesh_data import MeshData
from unilateral.bounds.residual_norm import ResidualParts
from unilateral.bounds.source import Source
from unilateral.bounds.total_errors import Residual, total_errors
from unilateral.fem.condense import matrix
from unilateral.fem.form import H1, Form
from unilateral.fem.linear_systems import solved
from unilateral.fem.p1 import edge_load, lumped_mass, of_rest
from unilateral.fem.p2 import Quadratic, linear_squares, quadratic, squares
from unilateral.geometry.partition import Partition

ENOUGH = 0.01
"""The steps end when one of v and one of q together lower eta^2 by less than this fraction of it.

The next ones would take less still.
"""
MOST_STEPS = 50
"""At most this many steps are made. Some 7 are enough: their number does not depend on the mesh."""
UNBALANCED = 0.01
"""What the patches leave of div q may have this fraction of the square of the norm of the error of w in L2.

That is like the sum over the triangles of min(h^2 / (k W^2), 1) ||q - k grad w||^2 / k, relative to W^2, with
||v||_0 <= W |||v|||.
"""


def sharp_bound(
    data: MeshData,
    cells: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    potential: Array | None = None,
) -> Bound:
    """Bounds for what `local_bound` takes, which raises InputError likewise.

    w is the `potential`, by default u_h, or near it. The nearer it and lambda_H are to the discrete solution,
    the sharper the bounds are.
    """
    mesh = data.mesh
    source = data.source
    tau = data.tau
    check(mesh, cells, u_h, lambda_H, form)
    flux, spaces = edge_flux(mesh, cells, lambda_H), quadratic(mesh)
    lift = lifting(data.constraint, u_h, flux)
    field = _field(spaces, source, u_h if potential is None else potential, flux.ends + tau.ends, form)

    # y = u_h + y less u_h, and what is missing of y
    of_u = spaces.of_hats(u_h - field.w)
    of_lifted, short = _lifted(lift, field, of_u)
    y, added = of_lifted - of_u, root(lift.added(short))
    D = spaces.norm(y, form) + short.norm + added

    # The part of y that does not vanish on clamped sides
    nodes, edges = np.split(spaces.of_boundary, 2)
    clamped = form.edges(mesh)
    inner = np.ones(spaces.size, dtype=bool)
    inner[nodes[clamped | np.roll(clamped, 1)]] = inner[edges[clamped]] = False
    D_clamped = spaces.norm(np.where(inner, 0.0, y), form) + root(short.squares[clamped]) + added

    # The flux q + curl phi and a feasible v, w plus of_v
    load = spaces.load(source.f_h) + spaces.edge_load(flux.ends + tau.ends)
    of_v, phi, steps = _descended(lift, field, load, 2 * short.product)
    field = field.turned(phi)
    of_v, short_of_v = _lifted(lift, field, of_v)
    added_to_v = root(lift.added(short_of_v))
    errors = total_errors(
        form,
        Residual(field.parts(of_u), tau.distance, short.product),
        Residual(field.parts(of_v), short_of_v.norm + added_to_v + tau.distance, short_of_v.product),
        D=(1 + SUMS) * D,
        D_clamped=(1 + SUMS) * D_clamped,
        of_sigma=flux.distance(mesh),
    )
    doubt = max(added, added_to_v) + tau.unknown
    return Bound(
        u=errors.u,
        lambda_=errors.lambda_ if form.held(mesh.side).any() else 0.0,
        lifting=D,
        data=0.0,
        unknown=form.value_constant * source.unknown + doubt,
        irreducible=doubt + form.value_constant * source.irreducible,
        eta=errors.eta,
        steps=steps,
        outflows=field.outflows,
        of_fluxes=errors.fluxes,
    )


@dataclass(frozen=True, eq=False)
class _Field:
    """q - k grad w and f_h + div q - c w for a flux q and w (n,) of V_h; functions v of P2 are given by v - w.

    The first one has the coefficients `hats` and `bubbles` (m, 3, 2), the second one the values `rho` (m, 3) at
    the nodes. `rounding` (2, m) is what rounding and the exact mesh may add to both norms on each triangle.
    `outflows` are those of a `Bound`: curl phi changes none but within a row of clamped sides.
    """

    spaces: Quadratic
    source: Source
    form: Form
    w: Array
    hats: Array
    bubbles: Array
    rho: Array
    rounding: Array
    outflows: Array

    def turned(self, phi: Array) -> _Field:
        """The same for q + curl phi in place of q."""
        hats = self.hats + _curl(self.spaces.gradient(phi))
        mesh = self.spaces.mesh
        of_phi = (ROUNDING + mesh.distortion) * self._sizes(phi) * mesh.longest_edges / mesh.areas
        return replace(self, hats=hats, rounding=self.rounding + [of_phi, np.zeros_like(of_phi)])

    def squares(self, d: Array) -> Array:
        """(3, m) squared norms for v = w + d: of q - k grad v, of rho less its mean, and of its mean."""
        k, c, areas = self.form.k, self.form.c, self.spaces.mesh.areas
        of_hats, of_bubbles = self.spaces.coefficients(d)
        hats, bubbles = self.rho - c * of_hats, -c * of_bubbles
        mean = hats.mean(axis=1) + bubbles.sum(axis=1) / 3
        of_gradients = squares(areas, self.hats - k * self.spaces.gradient(d), self.bubbles)
        return np.stack([of_gradients, squares(areas, hats - mean[:, None], bubbles), areas * mean**2])

    def parts(self, d: Array) -> ResidualParts:
        """The parts of the residual of v = w + d."""
        mesh, source, sizes = self.spaces.mesh, self.source, ROUNDING * self._sizes(d)
        misfit, oscillation, mean = np.sqrt(self.squares(d))
        return ResidualParts(
            mesh,
            misfit + self.rounding[0] + self.form.k * sizes * mesh.longest_edges / mesh.areas,
            oscillation=oscillation + source.oscillation,
            mean=mean,
            rest=source.rest + self.rounding[1] + self.form.c * sizes,
            by_parts=np.full_like(mean, math.inf),
        )

    def _sizes(self, d: Array) -> Array:
        """(m,) the root of the area times the sum of the coefficients of d; heights are 2 area / edge."""
        return np.sqrt(self.spaces.mesh.areas) * np.abs(d[self.spaces.unknowns]).sum(axis=1)


def _curl(slope: Array) -> Array:
    """(m, 3, 2) (d_y phi, -d_x phi), from (d_x phi, d_y phi)."""
    return np.stack([slope[..., 1], -slope[..., 0]], axis=2)


def balanced(source: Source, u_h: Array, sigma: Array, form: Form = H1) -> tuple[Array, Array, Array, Array]:
    """w (n,), the flux of patches for w, the means (m,) of f_h + div q - c w, and the rounding (2, m).

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges; on free sides these are given.
    What the solver left of the discrete equations for u_h, and the flux on the edges of lambda_H, is in these
    means. It may be nothing beside the error of u_h, and much beside the error of lambda_H, which is smaller.
    """
    mesh, W = source.mesh, form.value_constant
    w, sizes = u_h, np.minimum(mesh.longest_edges / (math.sqrt(form.k) * W), 1.0)
    for last in (False, True):
        q = flux_of(source, w, sigma, form)
        misfit_squares, mean, rounding = defects(source, w, q, form)
        error = float(sizes**2 @ misfit_squares) / form.k
        least = max(UNBALANCED * error / W**2, float(rounding[1] @ rounding[1]))
        if last or mesh.areas @ mean**2 <= least:
            break
        w = _solved(source, w, sigma, least, form)
    return w, q, mean, rounding


def _solved(source: Source, w: Array, sigma: Array, least: float, form: Form) -> Array:
    """w with (w, psi_a) = (f, psi_a) + <sigma, psi_a>, up to an error that div q may have.

    Let r_a be what is left of this equation. Patch a spreads it over the area |a| of its triangles, and at
    most three patches lie at any place. So the square of what div q lacks is at most sum 3 r_a^2 / |a|, which
    is brought down to `least`.
    """
    mesh, held = source.mesh, np.where(form.fixed(source.mesh), w, 0.0)
    rhs = of_rest(mesh, form, source.load + edge_load(mesh, sigma), held)
    return held + solved(matrix(mesh, form), rhs, w - held, lumped_mass(mesh), least)[0]


def _field(spaces: Quadratic, source: Source, u_h: Array, sigma: Array, form: Form = H1) -> _Field:
    """The `_Field` of the flux with q.n = sigma (nb, 2) and with theta r, for w by `balanced`."""
    mesh = spaces.mesh
    w, q, mean, rounding = balanced(source, u_h, sigma, form)

    # theta r, and what it leaves of the mean-free part of rho
    p, x = form.c * w[mesh.triangles] - source.f_h, mesh.points[mesh.triangles]
    along, fall = np.roll(x, -1, axis=1) - x, p - np.roll(p, -1, axis=1)
    r, p_free = fall[..., None] * along / 12, p - p.mean(axis=1, keepdims=True)
    of_div, of_r = form.k * linear_squares(mesh.areas, p_free), form.c * squares(mesh.areas, np.zeros_like(r), r)
    theta = np.divide(of_div, of_div + of_r, out=np.ones_like(of_r), where=of_div > 0)[:, None]
    size = (ROUNDING + mesh.distortion) * np.sqrt(mesh.areas) * np.abs(p).max(axis=1)
    return _Field(
        spaces,
        source,
        form,
        w,
        hats=-misfit(mesh, form.k * w, q, slice(None)),
        bubbles=theta[..., None] * r,
        rho=mean[:, None] - (1 - theta) * p_free,
        rounding=rounding + [mesh.longest_edges * size, 2 * size],
        outflows=outflows(mesh, form, q),
    )


def _lifted(lift: Lifting, field: _Field, d: Array) -> tuple[Array, Missing]:
    """d (size,) plus what makes w + d feasible, and what is missing then."""
    of = field.spaces.of_boundary
    nodal, bubbles = np.split(d[of], 2)
    *more, short = lift.lifted(field.w[field.spaces.mesh.boundary] + nodal, bubbles)
    lifted = d.copy()
    lifted[of] += np.concatenate(more)
    return lifted, short


def _descended(lift: Lifting, field: _Field, load: Array, slack: float) -> tuple[Array, Array, int]:
    """d = v - w and phi (size,), and how many steps were made.

    `load` (size,) is that of v, and `slack` is nearly 2 <sigma, v - g>.
    """
    spaces, form, w = field.spaces, field.form, field.spaces.of_hats(field.w)
    d, outer = np.zeros(spaces.size), np.zeros(len(spaces.of_boundary), dtype=bool)
    outer[lift.g.unknowns[~lift.g.clamped]], outer[0] = True, True
    d[spaces.of_boundary] = np.concatenate(lift.met(field.w[spaces.mesh.boundary]))
    free, inner = spaces.free(lift.contact), spaces.free(outer)
    of_gradients, *of_values = field.squares(d).sum(axis=1)
    square = of_gradients / form.k + form.value_constant**2 * sum(of_values) + slack

    # ||q + curl phi - k grad w||^2 / k, and a(v, v) - 2 (f_h, v) - 2 <q.n, v>
    curls = spaces.load_of_gradients(_curl(field.hats), _curl(field.bubbles))
    of_phi = spaces.descent(spaces.matrix(Form(1 / form.k, 0.0)), curls / form.k, np.zeros(spaces.size), inner)
    of_v = spaces.descent(spaces.matrix(form), load, w + d, free)
    gain, steps = math.inf, 0
    while gain > ENOUGH * abs(square) and steps < MOST_STEPS:  # below 0 where v < g
        gain = of_v.step() + of_phi.step()
        square, steps = square - gain, steps + 1
    return d + free @ of_v.x, inner @ of_phi.x, steps
