"""The guaranteed total error of a discrete solution, by a flux and a potential that are nearly the best ones.

Symbols as in `total_errors`: u_h + y is feasible, D = |||y|||, B = <sigma, u_h + y - g>, S bounds the
residual on functions that vanish on clamped sides; s' is the second bound of `residual_norm` on a triangle.

The bounds follow from the residuals of u_h and of a feasible v with one flux q (`bound_total_errors`). Both v
and q begin with w of V_h, u_h or near it, and the flux of `equilibrate_flux` for w (`balance_potential`).

The flux gets a divergence that is linear on each triangle T. With p = c w - f_h, its values p_k at the nodes
x_k, and the hats psi_k there, q gets theta r,

    r = sum_k p_k psi_k (x - x_k) / 3,     div r = p - mean p,     r.n = 0 on the edges,
    theta = k ||div r||_T^2 / (k ||div r||_T^2 + c ||r||_T^2),

since div (psi_k (x - x_k)) = 3 psi_k - 1. f_h is the linear part of f. On small triangles theta is nearly 1,
and the mean-free part of rho = f_h + div q - c w nearly 0; on triangles larger than (k/c)^{1/2} all of r
would cost more than it gains, and on much larger ones theta is 0. With curl phi, phi of P2 and 0 on the
boundary but for clamped sides, div q, and q.n on the other sides, stay what they are. These are all fluxes of
RT1 with those if the other sides make one arc; else those with the same flow through each row of clamped
sides. The potential v of P2 is g where (u_h, lambda_H) is in contact, u_D on clamped sides, and goes
from w towards the solution of (1.1) with k dv/dn = tau~ on free sides and 0 elsewhere; at last it is made
feasible. For f_h, without rounding, S^2 + 2 B of a feasible v is at most eta^2, which both reduce,

    eta^2 = ||q - k grad v||^2 / k + ||f_h + div q - c v||^2 / c + 2 <sigma, v - g>,

independently of each other: (grad v, curl phi) = 0, and the best v does not depend on q. They are found by
conjugate gradients, and every iterate will do.

Where u and f are smooth the bound of u tends to the energy norm of u - u_h, as eta is of higher order.
Nothing is assumed of u_h and lambda_H. What rounding and the exact mesh may do is added on each triangle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from unilateral.arrays import Array, Mask
from unilateral.bounds.boundary_flux import GivenEdgeFlux, build_normal_flux, no_given_flux
from unilateral.bounds.clamped_ends import outflows
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.equilibrated_flux import triangle_inflows
from unilateral.bounds.feasible import Lift, Lifting, build_lifting
from unilateral.bounds.flux_residuals import (
    SUM_ROUNDING,
    add_given_flux_remainder,
    misfit,
    residual_parts,
    rounding_allowances,
    stretched_divergence,
)
from unilateral.bounds.local_bounds import Bound, check_discrete_solution, collect_bounds, equilibrate_source
from unilateral.bounds.residual_norm import SQUARES_ROUNDING, ResidualParts
from unilateral.bounds.source import Source
from unilateral.bounds.total_errors import ResidualBounds, bound_residual, bound_total_errors
from unilateral.fem.condense import form_matrix
from unilateral.fem.form import Form
from unilateral.fem.linear_systems import solve_sparse
from unilateral.fem.p1 import edge_load, lumped_mass, subtract_lift_from_load
from unilateral.fem.p2 import QuadraticSpace, linear_square_norms, quadratic_space, quadratic_square_norms
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition

MIN_RELATIVE_GAIN = 0.01
"""The steps end when one of v and one of q together lower eta^2 by less than this fraction of it.

The next ones would take less still.
"""
MAX_DESCENT_STEPS = 50
"""At most this many steps are made. Some 7 are enough: their number does not depend on the mesh."""
THICK_TRIANGLE_LAYERS = 20.0
"""On triangles with an edge longer than this times (k/c)^{1/2} the flux stays as it is, and phi is 0.

There s' of `flux_residuals` counts, for u_h.
"""
MAX_IMBALANCE_FRACTION = 0.01
"""What w leaves of the discrete equations may be this fraction of the squared error of w in L2, over W^4.

W is that of ||z||_0 <= W |||z|||.
"""


def sharp_bound(
    data: EnclosedData,
    partition: Partition,
    u_h: Array,
    lambda_H: Array,
    form: Form,
    potential: Array | None = None,
) -> Bound:
    """Bounds for what `local_bound` takes and refuses; w is the `potential`, by default u_h, or near it."""
    mesh = data.mesh
    check_discrete_solution(mesh, partition, u_h, lambda_H, form)
    w = u_h if potential is None else potential

    # sigma near lambda_H, and the first q: that of `equilibrate_flux` for w, with theta r
    sigma = build_normal_flux(mesh, partition, lambda_H, w, form)
    w, q = balance_potential(data.source, w, sigma.end_values + data.given_flux.end_values, form)
    field = _build_misfit_field(quadratic_space(mesh), data.source, w, q, form)

    # y with u_h + y >= g, D = |||y|||, and D_D, the norm of the part of y at clamped sides
    lifting = build_lifting(data.constraint, form, u_h, sigma)
    y = lifting.make_feasible(u_h[mesh.boundary], np.zeros(len(mesh.boundary)))
    D, D_clamped = _lift_norms(lifting, y)

    # a better flux q + curl phi, and v = w + d that its own lift has made feasible
    field, d, v_lift, steps = _improve_flux_and_potential(lifting, field, data.given_flux, y)

    # S of u_h and of v (Lemma S18), and Theorem 8 (Proposition S14)
    u_residual, v_residual = _bound_improved_residuals(field, data.given_flux, u_h, q, y, d, v_lift)
    distance = sigma.multiplier_distance(mesh, form)
    errors = bound_total_errors(
        mesh.exact_mesh_factor, u_residual, v_residual, D=D, D_clamped=D_clamped, sigma_distance=distance
    )
    remainder_norm = max(y.remainder_norm, v_lift.remainder_norm)
    return replace(collect_bounds(data, form, errors, D, remainder_norm, field.outflows), steps=steps)


def _lift_norms(lifting: Lifting, y: Lift) -> tuple[float, float]:
    """D = |||y||| and D_D, the energy norm of the part of y at clamped sides: upper bounds on both."""
    layer = lifting.layer
    form = lifting.form
    # triangle inequality: y is hats and bubbles, extensions, and hats for the remainder of g
    y_norm = layer.norm(form, y.nodal, y.bubbles) + y.shortfall.extension_norm + y.remainder_norm
    clamped = form.clamped_edges(layer.mesh)
    clamped_nodal = np.where(clamped | np.roll(clamped, 1), y.nodal, 0.0)
    clamped_norm = layer.norm(form, clamped_nodal, np.where(clamped, y.bubbles, 0.0))
    clamped_norm += math.sqrt(float(y.shortfall.extension_squares[clamped].sum()))
    # the hats for the remainder are not told apart: all of them count as at clamped sides
    D = (1 + SQUARES_ROUNDING) * y_norm + y.underflow
    return D, (1 + SQUARES_ROUNDING) * (clamped_norm + y.remainder_norm) + y.underflow


def _improve_flux_and_potential(
    lifting: Lifting, field: _MisfitField, tau: GivenEdgeFlux, y: Lift
) -> tuple[_MisfitField, Array, Lift, int]:
    """The field of q + curl phi, d (size,) of v = w + d, the lift of v, and how many steps were made.

    d includes the hats and bubbles of that lift. To be feasible v still lacks the lift's extensions and its
    hats for the remainder of g, whose norm is at most its `missing_norm`.
    """
    spaces = field.spaces
    # v enters eta^2 by |||v|||^2 - 2 (f_h, v) - 2 <q.n, v> + 2 <sigma, v>. On sides with contact q.n = sigma,
    # and the last two cancel; on free sides q.n = tau~ is left; on clamped ones v is given
    load = spaces.load(field.source.f_h) + spaces.edge_load(tau.end_values)
    # until v is known 2 <sigma, v - g> of u_h + y stands for its own in eta^2, which only ends the steps
    d, phi, steps = _minimise_eta(lifting, field, load, 2 * y.shortfall.complementarity)
    nodal, bubbles = np.split(d[spaces.boundary_unknowns], 2)
    v_lift = lifting.make_feasible(field.w[spaces.mesh.boundary] + nodal, bubbles)
    d[spaces.boundary_unknowns] += np.concatenate([v_lift.nodal, v_lift.bubbles])
    return field.add_curl(phi), d, v_lift, steps


def _bound_improved_residuals(
    field: _MisfitField, tau: GivenEdgeFlux, u_h: Array, q: Array, y: Lift, d: Array, v_lift: Lift
) -> tuple[ResidualBounds, ResidualBounds]:
    """The bounds on the residuals of u_h and of v = w + d, with the field's flux; `q` is the first one."""
    tau_error = tau.projection_error(field.spaces.mesh, field.form)
    u_parts = field.residual_parts(field.spaces.embed_linear(u_h - field.w), tau)
    # theta r and curl phi are 0 on thick triangles: s' of the first q holds there
    if field.is_thick.any():
        s_prime = residual_parts(field.source, tau, u_h, q, field.form).s_prime
        u_parts = u_parts._replace(s_prime=np.where(field.is_thick, s_prime, math.inf))
    v_parts = field.residual_parts(d, tau)
    # what u_h lacks is y, with the norm D; what v lacks is added to its S (`total_errors`, the last sentence)
    v_missing = v_lift.missing_norm + tau_error
    u_residual = bound_residual(u_parts, tau_error, y.shortfall.complementarity)
    return u_residual, bound_residual(v_parts, v_missing, v_lift.shortfall.complementarity)


@dataclass(frozen=True, eq=False)
class _MisfitField:
    """q - k grad w and f_h + div q - c w for a flux q and w (n,) of V_h; v of P2 is given by v - w.

    The first one has the coefficients `misfit_hats` and `misfit_bubbles` (m, 3, 2), the second one the values
    `rho` (m, 3) at the nodes. `misfit_allowance` and `rho_allowance` (m,) are what rounding and the exact
    mesh may add to both on a triangle, and `is_thick` (m,) says where q stays as it is. `outflows` are those
    of a `Bound`: curl phi changes none but within a row of clamped sides.
    """

    spaces: QuadraticSpace
    source: Source
    form: Form
    w: Array
    misfit_hats: Array
    misfit_bubbles: Array
    rho: Array
    misfit_allowance: Array
    rho_allowance: Array
    is_thick: Mask
    outflows: Array

    def add_curl(self, phi: Array) -> _MisfitField:
        """The field for the flux q + curl phi."""
        mesh = self.spaces.mesh
        # the mean of |grad 4 psi_i psi_j|^2 is at most 4 / height^2, and a height twice the area over an edge
        size = np.abs(phi[self.spaces.unknowns]).sum(axis=1) * mesh.longest_edges / mesh.areas
        allowance = (SUM_ROUNDING + mesh.distortion) * size
        misfit_hats = self.misfit_hats + _curl(self.spaces.gradient(phi))
        return replace(self, misfit_hats=misfit_hats, misfit_allowance=self.misfit_allowance + allowance)

    def square_norms(self, d: Array) -> Array:
        """The squared norms (3, m) of q - k grad v, of rho less its mean, and of its mean, for v = w + d.

        The bounds weigh the mean of rho and the rest differently.
        """
        k = self.form.k
        c = self.form.c
        areas = self.spaces.mesh.areas
        d_hats, d_bubbles = self.spaces.coefficients(d)
        rho_hats = self.rho - c * d_hats
        rho_bubbles = -c * d_bubbles
        # the means of a hat and of a bubble are 1/3
        mean = rho_hats.mean(axis=1) + rho_bubbles.sum(axis=1) / 3
        misfit_squares = quadratic_square_norms(
            areas, self.misfit_hats - k * self.spaces.gradient(d), self.misfit_bubbles
        )
        oscillation_squares = quadratic_square_norms(areas, rho_hats - mean[:, None], rho_bubbles)
        return np.stack([misfit_squares, oscillation_squares, areas * mean**2])

    def residual_parts(self, d: Array, given_flux: GivenEdgeFlux) -> ResidualParts:
        """The parts of the residual of v = w + d, with what is left of tau; s' is infinite."""
        mesh = self.spaces.mesh
        source = self.source
        form = self.form
        size = SUM_ROUNDING * np.abs(d[self.spaces.unknowns]).sum(axis=1)
        misfit_allowance = self.misfit_allowance + form.k * size * mesh.longest_edges / mesh.areas
        rho_allowance = self.rho_allowance + form.c * size
        misfit_norm, rho_norm, mean = np.sqrt(self.square_norms(d))
        # p - f_h is orthogonal to linear functions
        is_linear = not np.any(d[len(self.w) :])
        mean_free = np.hypot(rho_norm, source.oscillation) if is_linear else rho_norm + source.oscillation
        residual = ResidualParts(
            mesh,
            form,
            misfit=misfit_norm + np.sqrt(mesh.areas) * misfit_allowance,
            oscillation=mean_free + source.jumps,
            mean=mean,
            remainder=source.remainder + np.sqrt(mesh.areas) * rho_allowance,
            s_prime=np.broadcast_to(math.inf, mean.shape),
        )
        add_given_flux_remainder(residual, given_flux)
        return residual


def _curl(gradient: Array) -> Array:
    """The curl (d_y phi, -d_x phi) at the nodes of each triangle, from the gradient of phi, (m, 3, 2)."""
    return np.stack([gradient[..., 1], -gradient[..., 0]], axis=2)


def balance_potential(source: Source, u_h: Array, sigma: Array, form: Form) -> tuple[Array, Array]:
    """w (n,), u_h or a better solution of the discrete equations, and the flux by `equilibrate_flux` for w.

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges; on free sides these are given.
    What a solver left of the discrete equations, and what the flux on the edges leaves of lambda_H, may be
    nothing beside the error of u_h, and much beside the error of lambda_H, which is smaller.
    """
    mesh = source.mesh
    q = equilibrate_source(source, u_h, sigma, form)
    residual = residual_parts(source, no_given_flux(mesh), u_h, q, form)
    # the error of u_h in L2 over W^2 is nearly ||q - k grad u_h||_T min(h / W, k^{1/2}) / (k W)
    W = form.value_constant
    error = np.minimum(mesh.longest_edges / W, math.sqrt(form.k)) * residual.misfit / (form.k * W)
    # S has M_T + E_T: a mean below E_T hardly counts, nor does one far below the error
    tolerance = max(
        MAX_IMBALANCE_FRACTION * float(error @ error), float(residual.remainder @ residual.remainder)
    )
    if residual.mean @ residual.mean <= tolerance:
        return u_h, q
    w = _solve_discrete_equations(source, u_h, sigma, tolerance, form)
    return w, equilibrate_source(source, w, sigma, form)


def _solve_discrete_equations(source: Source, w: Array, sigma: Array, tolerance: float, form: Form) -> Array:
    """w with k (grad w, grad psi_a) + c (w, psi_a) = (f, psi_a) + <sigma, psi_a>, up to what div q may lack.

    Let r_a be what is left of this equation. Patch a spreads it over the area |a| of its triangles, and at
    most three patches lie at any place. So the square of what div q lacks is at most sum 3 r_a^2 / |a|, which
    is brought down to `tolerance`.
    """
    mesh = source.mesh
    lift = np.where(form.clamped_nodes(source.mesh), w, 0.0)
    rhs = subtract_lift_from_load(mesh, form, source.load + edge_load(mesh, sigma), lift)
    return lift + solve_sparse(form_matrix(mesh, form), rhs, w - lift, lumped_mass(mesh), tolerance)[0]


def _build_misfit_field(
    spaces: QuadraticSpace, source: Source, w: Array, q: Array, form: Form
) -> _MisfitField:
    """The `_MisfitField` of q + theta r for w; w and q are as `balance_potential` gives them."""
    mesh = spaces.mesh
    p = form.c * w[mesh.triangles] - source.f_h
    thick = form.c * mesh.longest_edges**2 > THICK_TRIANGLE_LAYERS**2 * form.k
    theta, r = _correct_divergence(mesh, p, form)
    theta = np.where(thick, 0.0, theta)[:, None]

    # f_h + div (q + theta r) - c w = div q - mean p - (1 - theta) (p - mean p)
    inflows = triangle_inflows(mesh, q, slice(None))
    div_q = -0.5 * (inflows[0] + inflows[1]).sum(axis=0) / mesh.areas
    rho = (div_q - p.mean(axis=1))[:, None] - (1 - theta) * (p - p.mean(axis=1, keepdims=True))

    # what rounding may do to w and q, and to r: |r| <= longest edge times |p|, |div r| <= 2 |p|
    largest = np.abs(w[mesh.triangles]).max(axis=1)
    misfit_allowance, rho_allowance = rounding_allowances(
        mesh, slice(None), largest, source.f_h.T, inflows, form, stretched_divergence(mesh, q)
    )
    p_rounding = (SUM_ROUNDING + mesh.distortion) * np.abs(p).max(axis=1)
    return _MisfitField(
        spaces,
        source,
        form,
        w,
        misfit_hats=-misfit(mesh, w, q, slice(None), form.k),
        misfit_bubbles=theta[..., None] * r,
        rho=rho,
        misfit_allowance=misfit_allowance + mesh.longest_edges * p_rounding,
        rho_allowance=rho_allowance + 2 * p_rounding,
        is_thick=thick,
        outflows=outflows(mesh, form, q),
    )


def _correct_divergence(mesh: Mesh, p: Array, form: Form) -> tuple[Array, Array]:
    """theta (m,), and r by the coefficients (m, 3, 2) of its bubbles; p has the values (m, 3) at nodes."""
    # on the edge from x_i to x_j r is a bubble, 4 psi_i psi_j, times (p_i - p_j) (x_j - x_i) / 12
    x = mesh.points[mesh.triangles]
    r = (p - np.roll(p, -1, axis=1))[..., None] * (np.roll(x, -1, axis=1) - x) / 12
    # theta = k ||div r||^2 / (k ||div r||^2 + c ||r||^2), div r = p - mean p; any number where p is constant
    div_squares = form.k * linear_square_norms(mesh.areas, p - p.mean(axis=1, keepdims=True))
    total_squares = div_squares + form.c * quadratic_square_norms(mesh.areas, np.zeros_like(r), r)
    theta = np.divide(div_squares, total_squares, out=np.ones_like(total_squares), where=total_squares > 0)
    return theta, r


def _minimise_eta(
    lifting: Lifting, field: _MisfitField, load: Array, complementarity: float
) -> tuple[Array, Array, int]:
    """d = v - w and phi (size,) that nearly minimise eta^2, and how many steps were made.

    `load` (size,) is that of v, and `complementarity` is nearly 2 <sigma, v - g>.
    """
    spaces = field.spaces
    form = field.form
    w = field.spaces.embed_linear(field.w)
    d = np.zeros(spaces.size)
    outer = np.zeros(len(spaces.boundary_unknowns), dtype=bool)
    outer[lifting.constraint.unknowns[~lifting.constraint.clamped_edges]] = True
    outer[0] = True  # constants have no curl
    # v starts as g in contact, and stays that there; phi is 0 on sides not clamped, and on thick triangles
    d[spaces.boundary_unknowns] = np.concatenate(lifting.meet_obstacle(field.w[spaces.mesh.boundary]))
    free = spaces.vanishing_basis(lifting.contact)
    inner = spaces.vanishing_basis(outer, spaces.unknowns[field.is_thick])

    # eta^2 before the first step, with W^2 in place of 1/c; both summands as quadratic functions
    misfit_squares, *rho_squares = field.square_norms(d).sum(axis=1)
    eta_square = misfit_squares / form.k + form.value_constant**2 * sum(rho_squares) + complementarity
    # |curl phi| is |grad phi|, and (p, curl phi) = - (curl p, grad phi) for the misfit p
    curl_load = spaces.gradient_load(_curl(field.misfit_hats), _curl(field.misfit_bubbles)) / form.k
    phi_descent = spaces.conjugate_gradients(
        spaces.matrix(Form(1 / form.k, 0.0)), curl_load, np.zeros(spaces.size), inner
    )
    v_descent = spaces.conjugate_gradients(spaces.matrix(form), load, w + d, free)
    gain = math.inf
    steps = 0
    # eta^2 is below 0 if v is far enough below g
    while gain > MIN_RELATIVE_GAIN * abs(eta_square) and steps < MAX_DESCENT_STEPS:
        gain = v_descent.step() + phi_descent.step()
        eta_square = eta_square - gain
        steps = steps + 1
    return d + free @ v_descent.x, inner @ phi_descent.x, steps
