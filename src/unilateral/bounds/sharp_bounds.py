"""The guaranteed total error of a discrete solution, by a flux and a potential that are nearly the best ones.

The bounds are for f_h, the linear part of f on each triangle, in place of f, and for tau~ in place of the
flux tau that is given on free sides; see `source` and `boundary_flux` for the rest. They begin with w of V_h,
which is u_h or near it, the flux q of `equilibrated` for w (`balanced`), and the lifting d of u_h as in
`local_bounds`.

The flux gets a divergence that is linear on each triangle T. With p = w - f_h, its values p_k at the nodes
x_k, and the hats psi_k there, q gets theta r,

    r = sum_k p_k psi_k (x - x_k) / 3,     div r = p - mean p,     r.n = 0 on the edges,
    theta = ||div r||_T^2 / (||div r||_T^2 + ||r||_T^2),

since div (psi_k (x - x_k)) = 3 psi_k - 1. On small triangles theta is nearly 1, and w - f_h - div q is nearly
0 there, but for what `balanced` leaves; on triangles larger than 1 all of r would cost more than it gains.
With curl phi, phi of P2 and 0 on the boundary but for clamped sides, div q, and q.n on the other sides, stay
what they are: these are all fluxes of RT1 with those. If c = 0, theta is 1, and the square of v - f_h - div q
is left out. The potential v of P2 is g where (u_h, lambda_H) is in contact, u_D on clamped sides, and goes
from w towards the solution of (1.1) with dv/dn = tau~ on free sides and 0 elsewhere; at last it is made
feasible. Both reduce

    eta^2 = ||grad v - q||^2 + ||v - f_h - div q||^2 + 2 <sigma, v - g>

independently of each other: (grad v, curl phi) = 0, and the best v does not depend on q. They are found by
conjugate gradients, and every iterate will do. With R and D as in `local_bounds`, for this q and f_h, and
with Y^2 = ||q - grad u||^2 + ||f_h + div q - u||^2 (supplement, Proposition S14 and (6) of S8.1),

    Y <= eta,     ||u - u_h||^2 <= R + 2 Y D - Y^2 <= R + D^2 - max(D - eta, 0)^2,

for the u of f_h and tau~; f - f_h and tau - tau~ add their norm.

Where u and f are smooth R^{1/2} tends to ||u - u_h||_1, and eta is of higher order. Nothing is assumed of u_h
and lambda_H. What rounding and the exact mesh may do to the sums over triangles is added, as in
`local_bounds`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import edge_flux
from unilateral.bounds.clamped_ends import outflows
from unilateral.bounds.feasible import Lifting, Missing, lifting
from unilateral.bounds.flux_residuals import ROUNDING, SUMS, defects, misfit, root, underflow
from unilateral.bounds.local_bounds import Bound, check, flux_of, of_divergence
from unilateral.bounds.mesh_data import MeshData
from unilateral.bounds.source import Source
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
"""||w - f - div q||^2 may be this fraction of the sum over the triangles of min(h, 1)^2 ||grad w - q||^2.

That sum is like ||u - w||_0^2.
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
    away = _away(spaces, source, u_h if potential is None else potential, flux.ends + tau.ends, form)
    of_u = spaces.of_hats(u_h - away.w)
    of_lifted, short = _lifted(lift, away, of_u)
    load = spaces.load(source.f_h) + spaces.edge_load(tau.ends)
    of_v, phi, steps = _descended(lift, away, load, 2 * short.product)
    away, (of_v, short_of_v) = away.turned(phi), _lifted(lift, away, of_v)
    added, added_to_v = (root(lift.added(each)) for each in (short, short_of_v))
    doubt = max(added, added_to_v) + tau.unknown
    distance = (1 + SUMS) * (spaces.norm(of_lifted - of_u) + short.norm + added)
    eta = math.hypot(away.norm(of_v) + short_of_v.norm + added_to_v, math.sqrt(2 * short_of_v.product))
    eta *= 1 + SUMS
    most = (1 + SUMS) * math.hypot(away.norm(of_u), math.sqrt(2 * short.product), distance)
    data_error = source.distance(form) + tau.distance + away.unbalanced
    data_error = (1 + SUMS) * data_error + underflow(mesh, form)
    of_lambda = min(distance + most, eta) + flux.distance(mesh) + data_error
    return Bound(
        u=mesh.growth * (_leg(most, max(distance - eta, 0.0)) + data_error),
        lambda_=mesh.growth * of_lambda if form.held(mesh.side).any() else 0.0,
        lifting=distance,
        data=data_error,
        unknown=form.value_constant * source.unknown + doubt,
        irreducible=doubt + form.value_constant * source.irreducible,
        eta=eta,
        steps=steps,
        outflows=away.outflows,
        of_fluxes=mesh.growth * (of_lambda + data_error),
    )


def _leg(hypotenuse: float, other: float) -> float:
    """The other leg of a right triangle; it is infinite if the hypotenuse is."""
    return (
        math.sqrt(hypotenuse - other) * math.sqrt(hypotenuse + other) if 0 < other < math.inf else hypotenuse
    )


@dataclass(frozen=True, eq=False)
class _Away:
    """How far a flux q is from w (n,) of V_h, for which it was made; functions v of P2 are given by v - w.

    `hats` and `bubbles` (m, 3, 2) are the coefficients of grad w - q, and `residual` (m, 3) are the values of
    w - f_h - div q; `rounding` is what rounding and the exact mesh may add to the root of a `square`. For
    `unbalanced` see `local_bounds.of_divergence`. `outflows` are those of a `Bound`: curl phi changes none
    but within a row of clamped sides.
    """

    spaces: Quadratic
    w: Array
    hats: Array
    bubbles: Array
    residual: Array
    rounding: float
    form: Form
    unbalanced: float
    outflows: Array

    def turned(self, phi: Array) -> _Away:
        """The same for q + curl phi in place of q, curl phi = (d_y phi, -d_x phi)."""
        hats = self.hats + _turned(self.spaces.gradient(phi))
        more = self._rounding(phi, ROUNDING + self.spaces.mesh.distortion)
        return replace(self, hats=hats, rounding=self.rounding + more)

    def square(self, d: Array) -> float:
        """||grad v - q||^2 + ||v - f_h - div q||^2 for v = w + d; without a reaction the first of both."""
        areas, (hats, bubbles) = self.spaces.mesh.areas, self.spaces.coefficients(d)
        of_gradient = squares(areas, self.hats + self.spaces.gradient(d), self.bubbles)
        of_values = squares(areas, hats + self.residual, bubbles)
        return float((of_gradient + self.form.c * of_values).sum())

    def norm(self, d: Array) -> float:
        """The root of `square`, with rounding added: it is not below the exact root."""
        return math.sqrt(self.square(d)) + self.rounding + self._rounding(d, ROUNDING)

    def _rounding(self, d: Array, by: Array | float) -> float:
        """The rounding of d and its gradient, which is the fraction `by` (m,) of their sizes.

        A height of a triangle is twice its area over an edge.
        """
        mesh, largest = self.spaces.mesh, np.abs(d[self.spaces.unknowns]).sum(axis=1)
        sizes = by * largest * (1 + mesh.longest_edges / mesh.areas)
        return math.sqrt(float(mesh.areas @ sizes**2))


def _turned(field: Array) -> Array:
    """(m, 3, 2) the field, turned by a right angle to the left."""
    return np.stack([-field[..., 1], field[..., 0]], axis=2)


def balanced(source: Source, u_h: Array, sigma: Array, form: Form = H1) -> tuple[Array, Array, Array, float]:
    """w (n,), its flux as `equilibrated` gives it, w - f_h - div q (m,), and what rounding adds to the norms.

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges; on free sides these are given.
    For u_h itself div q is w - f_h up to what the solver left of the discrete equations and what the flux on
    the edges leaves of lambda_H. This may be nothing beside the error of u_h, and much beside the error of
    lambda_H, which is smaller.
    """
    w = u_h
    for last in (False, True):
        q = flux_of(source, w, sigma, form)
        of_gradient, residual, rounding = defects(source, w, q, form.c)
        sizes = np.minimum(source.mesh.longest_edges, 1.0)
        least = max(UNBALANCED * float(sizes**2 @ of_gradient), rounding**2)
        if last or source.mesh.areas @ residual**2 <= least:
            break
        w = _solved(source, w, sigma, least, form)
    return w, q, residual, rounding


def _solved(source: Source, w: Array, sigma: Array, least: float, form: Form) -> Array:
    """w with (w, psi_a) = (f, psi_a) + <sigma, psi_a>, up to an error that div q may have.

    Let r_a be what is left of this equation. Patch a spreads it over the area |a| of its triangles, and at
    most three patches lie at any place. So the square of what div q lacks is at most sum 3 r_a^2 / |a|, which
    is brought down to `least`.
    """
    mesh, held = source.mesh, np.where(form.fixed(source.mesh), w, 0.0)
    rhs = of_rest(mesh, form, source.load + edge_load(mesh, sigma), held)
    return held + solved(matrix(mesh, form), rhs, w - held, lumped_mass(mesh), least)[0]


def _away(spaces: Quadratic, source: Source, u_h: Array, sigma: Array, form: Form = H1) -> _Away:
    """The `_Away` of the flux with q.n = sigma (nb, 2) and with theta r, for w by `balanced`."""
    mesh = spaces.mesh
    w, q, residual, rounding = balanced(source, u_h, sigma, form)
    unbalanced, residual = of_divergence(form, mesh.areas, residual, rounding)
    p, x = form.c * w[mesh.triangles] - source.f_h, mesh.points[mesh.triangles]
    along, by = np.roll(x, -1, axis=1) - x, np.roll(p, -1, axis=1) - p
    of_r, rest = by[..., None] * along / 12, p - p.mean(axis=1, keepdims=True)
    of_field = squares(mesh.areas, np.zeros_like(of_r), of_r) if form.c else np.zeros(len(p))
    theta = _share(linear_squares(mesh.areas, rest), of_field)[:, None]
    sizes = (ROUNDING + mesh.distortion) * (mesh.longest_edges + 2) * np.abs(p).max(axis=1)
    rounding += math.sqrt(float(mesh.areas @ sizes**2))
    left = residual[:, None] + (1 - theta) * rest
    of_q = misfit(mesh, w, q, slice(None)), theta[..., None] * of_r
    return _Away(spaces, w, *of_q, left, rounding, form, unbalanced, outflows(mesh, form, q))


def _share(a: Array, b: Array) -> Array:
    """a / (a + b), or 1 where a is 0."""
    return np.divide(a, a + b, out=np.ones_like(a), where=a > 0)


def _lifted(lift: Lifting, away: _Away, d: Array) -> tuple[Array, Missing]:
    """d (size,) plus what makes w + d feasible, and what is missing then."""
    of = away.spaces.of_boundary
    nodal, bubbles = np.split(d[of], 2)
    *more, short = lift.lifted(away.w[away.spaces.mesh.boundary] + nodal, bubbles)
    lifted = d.copy()
    lifted[of] += np.concatenate(more)
    return lifted, short


def _descended(lift: Lifting, away: _Away, load: Array, slack: float) -> tuple[Array, Array, int]:
    """d = v - w and phi (size,), and how many steps were made.

    `load` (size,) is that of v, and `slack` is nearly 2 <sigma, v - g>.
    """
    spaces, w = away.spaces, away.spaces.of_hats(away.w)
    d, outer = np.zeros(spaces.size), np.zeros(len(spaces.of_boundary), dtype=bool)
    outer[lift.g.unknowns[~lift.g.clamped]], outer[0] = True, True
    d[spaces.of_boundary] = np.concatenate(lift.met(away.w[spaces.mesh.boundary]))
    square, free, inner = away.square(d) + slack, spaces.free(lift.contact), spaces.free(outer)
    field = spaces.load_of_gradients(_turned(away.hats), _turned(away.bubbles))
    of_phi = spaces.descent(spaces.matrix(mass=0), field, np.zeros(spaces.size), inner)
    of_v = spaces.descent(spaces.matrix(away.form.c), load, w + d, free)
    gain, steps = math.inf, 0
    while gain > ENOUGH * abs(square) and steps < MOST_STEPS:  # below 0 where v < g
        gain = of_v.step() + of_phi.step()
        square, steps = square - gain, steps + 1
    return d + free @ of_v.x, inner @ of_phi.x, steps
